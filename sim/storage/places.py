"""The folder of a user's data, for everything that stores or finds something there."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import platformdirs

HOME = "ADAPTSIM_HOME"
"""The variable that moves data and the user's settings to one folder."""


def data_folder(env: Mapping[str, str] | None = None) -> Path:
    """The folder of data in this environment; it need not exist."""
    home = (os.environ if env is None else env).get(HOME)
    if home:
        return Path(home).expanduser().absolute() / "data"
    return Path(platformdirs.user_data_dir("adaptsim", appauthor=False))
