"""Files that a person may have written or received, read within bounds: no file can hang a command or fill the memory.

Reads TOML, JSON, PNG and JPEG, and checks safetensors before its library opens them. Every defect of a file raises
`Unreadable`; its message continues a sentence that begins with the file's name. Images are encoded here too.
"""

from __future__ import annotations

import json
import math
import re
import stat
import struct
import tomllib
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

TOML_BYTES = 4 * 2**20
JSON_BYTES = 64 * 2**20
IMAGE_BYTES = 64 * 2**20
IMAGE_PIXELS = 2**26
TENSOR_BYTES = 4 * 2**30
TENSOR_HEADER_BYTES = 2**20
DEEPEST = 32
"""Most levels of nested tables and arrays, and most parts of a key."""

_LARGEST = 2**63
_PIECES = re.compile(rb"[={,\n]")
_CUT = "is cut short or damaged"
_NO_IMAGE = "is not a whole PNG or JPEG image"
_PNG = b"\x89PNG\r\n\x1a\n"


class Unreadable(ValueError):
    """A file breaks a bound or its format; the message says how."""


def read_table(path: Path, *, finite: bool = True) -> dict[str, Any]:
    """The table of a TOML or JSON file. With `finite`, infinity and not-a-number are errors.

    Raises FileNotFoundError, Unreadable.
    """
    is_toml = path.suffix == ".toml"
    return parse_table(read_bytes(path, TOML_BYTES if is_toml else JSON_BYTES), is_toml=is_toml, finite=finite)


def parse_table(content: bytes, *, is_toml: bool, finite: bool = True) -> dict[str, Any]:
    """The table in the content of a file. Raises Unreadable."""
    try:
        data = _toml(content) if is_toml else json.loads(content.decode())
    except UnicodeDecodeError as error:
        raise Unreadable(f"is not UTF-8 text: {error.reason} at byte {error.start}") from error
    except (tomllib.TOMLDecodeError, json.JSONDecodeError) as error:
        raise Unreadable(f"is not valid {'TOML' if is_toml else 'JSON'}: {error}") from error
    except Unreadable:
        raise
    except RecursionError as error:
        raise Unreadable(_too_deep()) from error
    except ValueError as error:  # Python reads no integer of more than 4,300 digits
        raise Unreadable("contains an integer with thousands of digits") from error
    if not isinstance(data, dict):
        raise Unreadable("is not a table of keys and values")
    _require_bounds(data, finite=finite)
    return data


def read_bytes(path: Path, most: int) -> bytes:
    """The content of a file of at most `most` bytes. Raises FileNotFoundError, Unreadable."""
    require_file(path, most)
    try:
        with path.open("rb") as file:
            content = file.read(most + 1)
    except OSError as error:
        raise Unreadable(f"cannot be read: {error.strerror}") from error
    if len(content) > most:  # it grew
        raise Unreadable(f"has more than {most / 2**20:g} MB")
    return content


def require_file(path: Path, most: int) -> int:
    """The size in bytes of a regular file of at most `most` bytes. Raises FileNotFoundError, Unreadable."""
    try:
        status = path.stat()
    except FileNotFoundError:
        raise
    except OSError as error:
        raise Unreadable(f"cannot be read: {error.strerror}") from error
    if not stat.S_ISREG(status.st_mode):
        raise Unreadable("is a folder" if stat.S_ISDIR(status.st_mode) else "is not a file")
    if status.st_size > most:
        raise Unreadable(f"has more than {most / 2**20:g} MB")
    return status.st_size


def require_tensors(path: Path) -> None:
    """Check that the header of a safetensors file is within bounds, and that the file is as long as the header says.

    Raises FileNotFoundError, Unreadable.
    """
    size = require_file(path, TENSOR_BYTES)
    with path.open("rb") as file:
        head = file.read(8)
        if len(head) < 8 or (length := int.from_bytes(head, "little")) > min(TENSOR_HEADER_BYTES, size - 8):
            raise Unreadable("is not a complete safetensors file: its header is cut short, or claims too much")
        table = parse_table(file.read(length), is_toml=False)
    ends = [entry["data_offsets"][-1] for entry in table.values() if _has_offsets(entry)]
    if len(ends) + ("__metadata__" in table) != len(table):
        raise Unreadable("is not a safetensors file: a tensor has no offsets")
    if max(ends, default=0) != size - 8 - length:
        raise Unreadable("is cut short or damaged: its tensors do not end where the file ends")


def _has_offsets(entry: object) -> bool:
    offsets = entry.get("data_offsets") if isinstance(entry, dict) else None
    return isinstance(offsets, list) and len(offsets) == 2 and all(isinstance(one, int) for one in offsets)


def decode_image(content: bytes, flags: int) -> NDArray[np.generic]:
    """(H, W) or (H, W, 3) of a PNG or JPEG, as `cv2.imdecode` with `flags`; 3 channels are BGR. Raises Unreadable."""
    import cv2  # noqa: PLC0415 - tables are read without it, by every command

    width, height = _image_size(content)
    if width * height > IMAGE_PIXELS:
        raise Unreadable(f"claims to have {width} x {height} pixels, too many to be read")
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except cv2.error as error:
        raise Unreadable("is damaged") from error
    if image is None:
        raise Unreadable(_CUT)
    return np.asarray(image)


def encode_image(image: NDArray[np.generic], suffix: str, quality: int | None = None) -> bytes:
    """(H, W) or (H, W, 3) BGR as ".jpg" or ".png", with OpenCV's own quality of a JPEG or compression of a PNG.

    Raises ValueError for an image that the format cannot hold.
    """
    import cv2  # noqa: PLC0415 - see `decode_image`

    option = cv2.IMWRITE_JPEG_QUALITY if suffix == ".jpg" else cv2.IMWRITE_PNG_COMPRESSION
    is_encoded, content = cv2.imencode(suffix, image, () if quality is None else (option, quality))
    if not is_encoded:
        raise ValueError(f"an image of shape {image.shape} and type {image.dtype} cannot be encoded as {suffix}")
    return content.tobytes()


def _toml(content: bytes) -> dict[str, Any]:
    """The number of parts of a key is bounded first, because the parser's time grows with its square."""
    if any(piece.count(b".") > DEEPEST for piece in _PIECES.split(content)):
        raise Unreadable(f"has a key of more than {DEEPEST} parts")
    return tomllib.loads(content.decode())


def _require_bounds(data: dict[str, Any], *, finite: bool) -> None:
    level: list[Any] = [data]
    for _ in range(DEEPEST):
        inner: list[Any] = []
        for value in level:
            if isinstance(value, float):  # the most frequent, so first
                if finite and not math.isfinite(value):
                    raise Unreadable(f"contains {value}, which is not a finite number")
            elif isinstance(value, dict):
                inner += value.values()
            elif isinstance(value, list):
                inner += value
            elif isinstance(value, int) and abs(value) >= _LARGEST:
                raise Unreadable("contains an integer of more than 63 bits")
        if not inner:
            return
        level = inner
    raise Unreadable(_too_deep())


def _too_deep() -> str:
    return f"has tables or arrays nested more than {DEEPEST} deep"


def _image_size(content: bytes) -> tuple[int, int]:
    """(width, height) as the header states them; of a PNG every chunk is whole.

    OpenCV allocates the stated length of a PNG's chunk before it reads it, which may be up to 4 GB.
    """
    from PIL.JpegImagePlugin import JpegImageFile  # noqa: PLC0415 - tables are read without it, by every command
    from PIL.PngImagePlugin import PngImageFile  # noqa: PLC0415

    is_png, why = content.startswith(_PNG), _NO_IMAGE
    try:
        with (PngImageFile if is_png else JpegImageFile)(BytesIO(content)) as image:  # opens the header alone
            size = image.size
            if is_png:
                why = _CUT
                image.verify()
    except (LookupError, OSError, SyntaxError, TypeError, ValueError, struct.error, zlib.error) as error:
        raise Unreadable(why) from error
    return size
