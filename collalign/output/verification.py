"""What was found about the certificates of a result, of its pairs and of the whole collection."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

#: A bound of ``pairs.csv`` counts as proven from this share of it on.
_PROVEN_SHARE = 1.0 - 1e-6


@dataclass(frozen=True, kw_only=True)
class CheckedCollection:
    """What was found about the proof of a collection.

    Attributes
    ----------
    num_shapes, num_pairs : int
    proven : float
        No arrangement of the shapes costs less; NaN where the proof is refused.
    energy : float
        Of the arrangement in the file.
    fault : str
        Why the proof is refused, empty if it is not.
    """

    num_shapes: int
    num_pairs: int
    proven: float
    energy: float
    fault: str = ""

    def __str__(self) -> str:
        if self.fault:
            return f"Collection: REFUSED, {self.fault}"
        more = f", {100 * (self.energy / self.proven - 1.0):.2f} % more" if self.proven > 0 else ""
        return (
            f"Collection: no arrangement of the {self.num_shapes} shapes costs less than {self.proven:.6g} over "
            f"{self.num_pairs} pairs; the cheapest one known costs {self.energy:.6g}{more}."
        )


@dataclass(frozen=True, kw_only=True)
class CheckedPair:
    """What was found about the certificate of one pair.

    Attributes
    ----------
    target, source : str
        The shapes' names.
    kind : str
        Of the certificate; empty where it could not be read.
    proven : float
        The lower bound of the pair's energy that it proves; NaN where it is refused.
    stated : float
        The lower bound in ``pairs.csv``, NaN where there is none.
    fault : str
        Why the certificate is refused, empty if it is not.
    """

    target: str
    source: str
    kind: str
    proven: float
    stated: float
    fault: str = ""


@dataclass(frozen=True, kw_only=True)
class Verification:
    """The certificates of a result, checked.

    Attributes
    ----------
    pairs : tuple of CheckedPair
    num_stated : int
        Pairs with a lower bound in ``pairs.csv``.
    collection : CheckedCollection or None
        What `collalign certify` left, where it did.
    """

    pairs: tuple[CheckedPair, ...]
    num_stated: int
    collection: CheckedCollection | None = None

    @property
    def holds(self) -> bool:
        """Whether no certificate is refused."""
        return not any(pair.fault for pair in self.pairs) and not (self.collection and self.collection.fault)

    @property
    def num_proven(self) -> int:
        """Number of pairs whose bound in ``pairs.csv`` is proven by their certificate."""
        return sum(pair.proven >= _PROVEN_SHARE * pair.stated for pair in self.pairs)

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON; a number that is not known is null."""
        record = {"holds": self.holds, "num_stated": self.num_stated, "num_proven": self.num_proven}
        found = record | {"pairs": [_known(asdict(pair)) for pair in self.pairs]}
        return found if self.collection is None else found | {"collection": _known(asdict(self.collection))}

    def table(self) -> str:
        """Return one line per certificate and what they say together."""
        lines = [
            f"{pair.target} - {pair.source}: "
            + (
                f"REFUSED, {pair.fault}"
                if pair.fault
                else f"{pair.kind} proves {pair.proven:.6g}, pairs.csv states {pair.stated:.6g}"
            )
            for pair in self.pairs
        ]
        refused = sum(bool(pair.fault) for pair in self.pairs)
        hold = "all hold" if not refused else f"{refused} REFUSED"
        lines.append(
            f"{len(self.pairs)} certificates, {hold}. pairs.csv states {self.num_stated} lower bounds: "
            f"{self.num_proven} are proven by a certificate, the others are the word of the program that found them."
        )
        return "\n".join(lines if self.collection is None else [*lines, str(self.collection)])


def _known(fields: dict[str, Any]) -> dict[str, Any]:
    """Return fields with null for numbers that are not known."""
    return {name: None if value != value else value for name, value in fields.items()}
