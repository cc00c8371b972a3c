"""Open3D, of which only the ray casting is used."""

from __future__ import annotations

import ctypes
import os
import sys
from types import ModuleType
from typing import Any

LIBRARIES = {"libEGL.so.1": "libegl1", "libGL.so.1": "libgl1", "libusb-1.0.so.0": "libusb-1.0-0"}
"""Each library of the system that Open3D loads, and its Debian package."""
_PLOTS = "open3d.visualization.draw_plotly"


def loads(library: str) -> bool:
    """Whether the dynamic linker finds and loads a library of this name."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def missing_libraries() -> str:
    """The sentence that names the libraries that Open3D cannot load here, and installs them; "" if it loads all."""
    names = [name for name in LIBRARIES if not loads(name)]
    if not names:
        return ""
    packages = " ".join(LIBRARIES[name] for name in names)
    return f"Open3D, which tracks objects, cannot load {', '.join(names)}: sudo apt-get install -y {packages}"


def load_open3d() -> Any:
    """Import Open3D without its plots for notebooks, which import plotly and dash.

    These would start a web framework: 0.3 s and 30 MB in every process. Raises OSError with the command that installs
    what the system lacks.
    """
    if "open3d" not in sys.modules:
        plots = ModuleType(_PLOTS, "Left out: see perception.raycasting.")
        vars(plots).update(dict.fromkeys(("get_plotly_fig", "draw_plotly", "draw_plotly_server")))
        sys.modules[_PLOTS] = plots
    os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")  # else it prints a line into every notebook
    try:
        import open3d  # noqa: PLC0415 - slow to import, and the first question comes without it
    except OSError as error:
        raise OSError(missing_libraries() or f"Open3D cannot be loaded: {error}") from error
    return open3d
