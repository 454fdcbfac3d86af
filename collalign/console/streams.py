"""Standard streams that are closed, full or read by nobody: what a command does never depends on them."""

from __future__ import annotations

import io
import os
import select
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout, suppress
from typing import TYPE_CHECKING

from data_tools.io.files import system_reason

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

#: Exit codes: output that cannot be written, and output that nobody reads any more: 128 and the number of SIGPIPE.
_UNWRITTEN, _READER_GONE = 1, 141
#: Names need not fit the encoding of a terminal.
_ERRORS = "backslashreplace"


class Standard(io.FileIO):
    """A descriptor that is written to as long as that works; what comes later is dropped.

    Attributes
    ----------
    error : OSError or None
        Why it cannot be written to any more.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor, "wb", closefd=False)
        self.error: OSError | None = None

    def write(self, data: ReadableBuffer) -> int:
        """Write all bytes, and return how many there are."""
        left = memoryview(data).cast("B")
        num_bytes = len(left)
        while left and self.error is None:
            try:
                written: int | None = super().write(left)
                if written is None:
                    select.select([], [self], [])  # another program made it one that does not wait
                left = left[written or 0 :]
            except OSError as error:
                self.error = error
        return num_bytes


class Streams:
    """The standard streams while a command runs; get them with :meth:`guarded`."""

    def __init__(self) -> None:
        self._out: Standard | None = None

    @classmethod
    @contextmanager
    def guarded(cls, *, until_exit: bool) -> Iterator[Streams]:
        """Put streams whose writing never fails in the place of those of this process; others stay as they are.

        Parameters
        ----------
        until_exit : bool
            The process ends after this: what it prints at its very end goes there too.
        """
        streams, former = cls(), ExitStack()
        if until_exit:
            _fill_closed()
        for name, redirect in (("stdout", redirect_stdout), ("stderr", redirect_stderr)):
            made = _guarded(getattr(sys, name))
            if made is not None:
                former.enter_context(redirect(made[0]))
                former.callback(made[0].flush)
                streams._out = made[1] if name == "stdout" else streams._out
        try:
            yield streams
        finally:
            if not until_exit:
                former.close()

    def code_after(self, code: int) -> int:
        """Return the exit code of a command that would end with this one; say why where output is missing."""
        if self._out is None:
            return code
        sys.stdout.flush()
        error = self._out.error
        if error is None:
            return code
        if isinstance(error, BrokenPipeError):  # as in "collalign ... | head -1"
            return _READER_GONE
        print(
            f"collalign: what was printed is lost ({system_reason(error)}); files are not affected",
            file=sys.stderr,
        )
        return code or _UNWRITTEN


def _fill_closed() -> None:
    """Open what is closed of the first three descriptors, which the next file would get otherwise."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            if os.open(os.devnull, os.O_RDWR) == descriptor:
                os.set_inheritable(descriptor, True)


def _guarded(stream: object) -> tuple[io.TextIOWrapper, Standard] | None:
    """Return a text stream in the place of another one, and what it writes to; None where the other stays."""
    if stream is None or getattr(stream, "closed", False):
        made = Standard(os.open(os.devnull, os.O_WRONLY))
        return io.TextIOWrapper(made, encoding="utf-8", errors=_ERRORS), made
    if not isinstance(stream, io.TextIOWrapper):
        return None
    is_buffered = isinstance(stream.buffer, io.BufferedWriter)
    raw = stream.buffer.raw if is_buffered else stream.buffer
    if not isinstance(raw, io.FileIO):  # the console of Windows
        stream.reconfigure(errors=_ERRORS)
        return None
    with suppress(OSError):
        stream.flush()
    made = Standard(raw.fileno())
    text = io.TextIOWrapper(
        io.BufferedWriter(made) if is_buffered else made,
        encoding=stream.encoding,
        errors=_ERRORS,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
    return text, made
