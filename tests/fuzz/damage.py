"""Damage to the bytes of a file, as disks, editors, converters and attackers do it, for Hypothesis."""

import os

from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st

#: How many times the examples of the suite are tried. More than once they differ with ``--hypothesis-seed``.
FACTOR = int(os.environ.get("FUZZ", "1"))
#: What no message may quote.
MARK = "Quoted17"
#: Pieces of text and numbers that parsers stumble over.
TOKENS = st.sampled_from(
    [
        *(MARK.encode(), b"nan", b"inf", b"-1", b"0", b"1e999", b"4294967295", b"9" * 22, b"\0"),
        *(b"\xff" * 4, b"\xff\xff\xff\x7f", b"\r", b"\n\n", b"#", b",", b"f 1 1 1\n"),
        *(b"end_header\n", b"\xef\xbb\xbf", b"'''", b"[[", b"../../../etc/passwd"),
    ]
)


def fuzzing(num):
    """Return the settings of a test that tries ``num`` examples in the suite."""
    return settings(
        max_examples=num * FACTOR,
        derandomize=FACTOR == 1,
        deadline=None,
        database=None,
        phases=(Phase.generate,),  # an example is one file already, so none is made smaller
        suppress_health_check=list(HealthCheck),
    )


@st.composite
def damaged(draw, files):
    """Return the name and bytes of a good file after one to four changes.

    Each replaces some bytes by others, by a token, by pieces of the same or another file, or by nothing.
    """
    name = draw(st.sampled_from(sorted(files)))
    data = files[name]
    for _ in range(draw(st.integers(1, 4))):
        at, end = draw(places(data)), draw(places(data))
        few = draw(st.sampled_from([0, 1, 8, 64]))
        other = files[draw(st.sampled_from(sorted(files)))]
        new = draw(
            st.one_of(
                st.binary(max_size=32),
                TOKENS,
                st.integers(1, 50).map(lambda num, piece=data[at : at + 20]: piece * num),
                places(other).map(lambda start, other=other: other[start : start + 64]),
            )
        )
        rest = draw(st.sampled_from([data[at + few :], data[end:], b""]))
        data = data[:at] + new + rest
    return name, data


def places(data):
    """Return positions in a file: half of them in the first 400 bytes, which decide how the rest is read."""
    return st.one_of(st.integers(0, min(len(data), 400)), st.integers(0, len(data)))
