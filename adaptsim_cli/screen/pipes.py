"""Output into a pipe whose reader may leave: `adaptsim ... | head`."""

from __future__ import annotations

import io
import sys
from typing import Any, TextIO


class PipeOutput(io.FileIO):
    """A file descriptor for writing. Output that nobody reads any more is dropped, so that the work continues."""

    def write(self, data: Any, /) -> int:
        """See `io.RawIOBase`; after the reader has left, everything counts as written."""
        try:
            return super().write(data) or 0
        except BrokenPipeError:
            return len(data)


def outlast_readers() -> None:
    """Let stdout and stderr outlast their readers, and replace characters that a terminal cannot show."""
    sys.stdout, sys.stderr = _outlasting(sys.stdout), _outlasting(sys.stderr)


def _outlasting(stream: TextIO) -> TextIO:
    if not isinstance(stream, io.TextIOWrapper):  # a test's, or none
        return stream
    if stream.isatty():
        stream.reconfigure(errors="replace")
        return stream
    stream.flush()
    output = io.BufferedWriter(PipeOutput(stream.fileno(), "wb", closefd=False))
    return io.TextIOWrapper(output, stream.encoding, "replace", line_buffering=True)
