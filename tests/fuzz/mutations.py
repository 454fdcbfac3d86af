"""Random damage to the bytes of a file: what disks, editors, converters and attackers do."""

#: What no message may quote.
MARK = "Quoted17"
#: Pieces of text and numbers that parsers stumble over.
TOKENS = (
    MARK.encode(),
    b"nan",
    b"inf",
    b"-1",
    b"0",
    b"1e999",
    b"4294967295",
    b"9999999999999999999999",
    b"\x00",
    b"\xff\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"\r",
    b"\n\n",
    b"#",
    b",",
    b"f 1 1 1\n",
    b"end_header\n",
    b"\xef\xbb\xbf",
    b"'''",
    b"[[",
    b"../../../etc/passwd",
)


def mutate(data, others, rng):
    """Return ``data`` after one or a few random changes; ``others`` are files to splice pieces from."""
    for _ in range(int(rng.geometric(0.6))):
        change = CHANGES[int(rng.integers(len(CHANGES)))]
        data = change(data, rng) if change is not _splice else _splice(data, rng, others)
    return data


def _place(data, rng):
    """A position, in the first 400 bytes half of the time: headers decide how the rest is read."""
    limit = len(data) + 1
    return int(rng.integers(min(limit, 400) if rng.random() < 0.5 else limit))


def _flip_bit(data, rng):
    if not data:
        return data
    at = min(_place(data, rng), len(data) - 1)
    return data[:at] + bytes([data[at] ^ 1 << int(rng.integers(8))]) + data[at + 1 :]


def _set_byte(data, rng):
    at = _place(data, rng)
    return data[:at] + bytes([int(rng.integers(256))]) + data[at + 1 :]


def _truncate(data, rng):
    return data[: _place(data, rng)]


def _remove(data, rng):
    at = _place(data, rng)
    return data[:at] + data[at + int(rng.integers(1, 64)) :]


def _repeat(data, rng):
    at = _place(data, rng)
    piece = data[at : at + int(rng.integers(1, 64))]
    return data[:at] + piece * int(rng.integers(2, 50)) + data[at:]


def _insert_token(data, rng):
    at = _place(data, rng)
    return data[:at] + TOKENS[int(rng.integers(len(TOKENS)))] + data[at:]


def _replace_number(data, rng):
    """Replace a run of digits near a random place."""
    at = _place(data, rng)
    digits = [i for i in range(at, min(at + 200, len(data))) if data[i : i + 1].isdigit()]
    if not digits:
        return _insert_token(data, rng)
    end = digits[0]
    while data[end : end + 1].isdigit():
        end += 1
    return data[: digits[0]] + TOKENS[int(rng.integers(8))] + data[end:]


def _swap_lines(data, rng):
    lines = data.split(b"\n")
    i, j = (int(k) for k in rng.integers(len(lines), size=2))
    lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def _noise(data, rng):
    at = _place(data, rng)
    length = int(rng.integers(1, 32))
    return data[:at] + rng.bytes(length) + data[at + length :]


def _splice(data, rng, others=None):
    other = others[int(rng.integers(len(others)))] if others else data
    return data[: _place(data, rng)] + other[_place(other, rng) :]


CHANGES = (
    _flip_bit,
    _set_byte,
    _truncate,
    _remove,
    _repeat,
    _insert_token,
    _replace_number,
    _swap_lines,
    _noise,
    _splice,
)
