"""The errors with which libraries read a damaged MCAP file. A wrong length is an arithmetic or a memory error."""

import struct

from mcap.exceptions import McapError
from zstandard import ZstdError

DAMAGED = (McapError, ZstdError, OSError, EOFError, ArithmeticError, LookupError, ValueError, MemoryError, struct.error)
