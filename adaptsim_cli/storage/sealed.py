"""Sealed records reveal later changes: the end of a file holds the SHA-256 of everything before it."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform

_JSON = (b',\n "sealed": "', b'"\n}\n')
_TOML = (b"# sha256 ", b"\n")
_DIGITS = 64

KEY = "sealed"
"""The key of the seal in a JSON file. In a TOML file the seal is a comment."""


class SealBroken(ValueError):
    """A file was changed after it was written."""


def seal_json(text: bytes) -> bytes:
    """Indented JSON of an object, sealed."""
    return _sealed(text.removesuffix(b"\n}\n"), _JSON)


def seal_toml(text: bytes) -> bytes:
    """TOML, sealed."""
    return _sealed(text, _TOML)


def require_seal(content: bytes, suffix: str) -> None:
    """Raises SealBroken unless a file of this suffix ends with its seal and is what was written."""
    before, after = _TOML if suffix == ".toml" else _JSON
    start = len(content) - len(before) - _DIGITS - len(after)
    if start < 0 or content[start : start + len(before)] != before or not content.endswith(after):
        raise SealBroken("has lost its checksum")
    if content != _sealed(content[:start], (before, after)):
        raise SealBroken("was changed after it had been written: its SHA-256 is another")


def _sealed(body: bytes, frame: tuple[bytes, bytes]) -> bytes:
    before, after = frame
    return body + before + hashlib.sha256(body).hexdigest().encode() + after


_VERSIONED = ("adaptsim", "drake", "numpy", "opencv-python-headless", "torch")


def versions() -> dict[str, str]:
    """The versions of Python and of the packages that results depend on."""
    found = {name: importlib.metadata.version(name) for name in _VERSIONED}
    return {"python": platform.python_version(), **found}
