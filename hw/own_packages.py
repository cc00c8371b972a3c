"""Imports our packages from the folder in which this file is installed, whatever else has one of their names.

A user's own `sim` or `hw.py` may lie beside a script, in the current folder or on PYTHONPATH. Python would mistake it
for our package. So this file is never imported by its name. `adaptsim_cli`, when it is imported, and every process that
we start run it by its path (`runpy.run_path`). As a program it runs one of our modules: own_packages.py MODULE
ARGUMENTS.
"""

import sys
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[1]
NAMES = ("hw", "perception", "calib", "sim")


def import_own() -> None:
    """Import the packages, so that their modules are found inside of them. Raises ImportError if one of the names
    belongs to another package.
    """
    for name in NAMES:
        if name in sys.modules:
            _require_own(name, sys.modules[name])
    sys.path.insert(0, str(ROOT))
    try:
        for name in NAMES:
            __import__(name)
    finally:
        sys.path.remove(str(ROOT))


def _require_own(name: str, module: ModuleType) -> None:
    places = [module.__file__] if module.__file__ else list(getattr(module, "__path__", ()))
    if Path(places[0] if places else "").resolve().is_relative_to(ROOT / name):
        return
    place = Path(places[0]) if places else Path(name)
    other = place.parent if place.name == "__init__.py" else place
    raise ImportError(
        f"adaptsim cannot import its own package {name!r}, because {other} was imported under that name before: rename "
        f"{other.name}, or import adaptsim_cli before it (then `import {name}` gives adaptsim's package everywhere)"
    )


import_own()

if __name__ == "__main__":
    import runpy

    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
