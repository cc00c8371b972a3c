"""The operator's command line."""

from pathlib import Path
from runpy import run_path

run_path(str(Path(__file__).parents[1] / "hw" / "own_packages.py"))
