"""Readers by the rules of the programs that have none packaged for Python: geomorph's morphologika, plain tables."""

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import FloatArray

_SECTIONS = (
    "individuals",
    "landmarks",
    "dimensions",
    "names",
    "labels",
    "labelvalues",
    "rawpoints",
    "wireframe",
)


@dataclass(frozen=True)
class Morphologika:
    """What a morphologika file says."""

    names: tuple[str, ...]
    points: FloatArray
    labels: tuple[str, ...]
    label_values: tuple[tuple[str, ...], ...]


def read_morphologika(path):
    """Read as geomorph does: a section begins at any line that *contains* its word, with or without brackets."""
    lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]

    def start(section):
        found = [
            at
            for at, line in enumerate(lines)
            if section in line.lower() and not (section == "labels" and "labelvalues" in line)
        ]
        if len(found) != 1:
            raise ValueError(f"section {section} begins in {len(found)} places")
        return found[0] + 1

    for section in ("individuals", "landmarks", "dimensions", "names", "rawpoints"):
        start(section)
    n, p, k = (int(lines[start(section)]) for section in ("individuals", "landmarks", "dimensions"))
    names = tuple(lines[start("names") : start("names") + n])
    body = lines[start("rawpoints") :]
    if len(body) != n * (p + 1) or any(
        not body[at].startswith("'") for at in range(0, len(body), p + 1)
    ):
        raise ValueError("each specimen needs a line with a quote and its name, then its landmarks")
    rows = [line.split() for at, line in enumerate(body) if at % (p + 1)]
    points = np.array(rows, dtype=np.float64).reshape(n, p, k)
    has_labels = any("labelvalues" in line for line in lines)
    values = lines[start("labelvalues") : start("labelvalues") + n] if has_labels else []
    return Morphologika(
        names=names,
        points=points,
        labels=tuple(lines[start("labels")].split()) if has_labels else (),
        label_values=tuple(tuple(line.split()) for line in values),
    )
