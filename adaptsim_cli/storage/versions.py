"""The versions that are stored with every record."""

from __future__ import annotations

import importlib.metadata
import platform

_VERSIONED = ("adaptsim", "drake", "numpy", "opencv-python-headless", "torch")


def versions() -> dict[str, str]:
    """The versions of Python and of the packages that results depend on."""
    found = {name: importlib.metadata.version(name) for name in _VERSIONED}
    return {"python": platform.python_version(), **found}
