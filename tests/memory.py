"""What a reader takes of memory for a file that claims more than it holds."""

import tracemalloc
from contextlib import contextmanager


@contextmanager
def most_memory(num_bytes):
    """Fail if the block takes more memory at any time, arrays included.

    Raises
    ------
    AssertionError
        Saying how much it took.
    """
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    if peak > num_bytes:
        raise AssertionError(f"{peak} bytes were taken, at most {num_bytes} may be")
