"""Open3D, of which only the ray casting is used."""

from __future__ import annotations

import os
import sys
from types import ModuleType
from typing import Any

_PLOTS = "open3d.visualization.draw_plotly"


def load_open3d() -> Any:
    """Import Open3D without its plots for notebooks, which import plotly and dash; `make setup` leaves both out.

    Where they are installed, they would start a web framework: 0.3 s and 30 MB in every process.
    """
    if "open3d" not in sys.modules:
        plots = ModuleType(_PLOTS, "Left out: see perception.raycasting.")
        vars(plots).update(dict.fromkeys(("get_plotly_fig", "draw_plotly", "draw_plotly_server")))
        sys.modules[_PLOTS] = plots
    os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")  # else it prints a line into every notebook
    import open3d  # noqa: PLC0415 - slow to import, and the first question comes without it

    return open3d
