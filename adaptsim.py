"""adaptsim for Python: sessions (`adaptsim.begin`), and tasks of your own (`@adaptsim.task`).

Everything is loaded when it is first used, so that the import takes no time. `adaptsim_cli.api` describes sessions, and
docs/guide/own-simulator.md describes tasks.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_TASKS = {
    "task": "sim.own.task",
    "mjcf": "sim.own.mujoco",
    "run_mujoco": "sim.own.mujoco",
    "gym": "sim.own.gym",
    "run_gym": "sim.own.gym",
    "drake": "sim.own.drake",
    "run_drake": "sim.own.drake",
    "program": "sim.own.program",
    "sensor": "sim.own.sensor",
}
_ERRORS = ("sim.errors", "adaptsim_cli.errors", "hw.errors", "perception.errors", "calib.errors")
_API = "adaptsim_cli.api"


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415 - only who asks

        return version("adaptsim")
    if name in _TASKS:
        return getattr(import_module(_TASKS[name]), name)
    if name.startswith("_"):
        raise AttributeError(name)
    if name[:1].isupper():
        for module in _ERRORS:
            if isinstance(error := getattr(import_module(module), name, None), type) and issubclass(error, Exception):
                return error
    api = import_module(_API)
    if name in api.__all__:
        return getattr(api, name)
    raise AttributeError(f"adaptsim has no {name!r}: there is {', '.join(n for n in __dir__() if n[0].islower())}")


def __dir__() -> list[str]:
    errors = (name for module in _ERRORS for name, one in vars(import_module(module)).items() if _is_error(one))
    return sorted({*_TASKS, *import_module(_API).__all__, *errors, "__version__"})


def _is_error(one: object) -> bool:
    return isinstance(one, type) and issubclass(one, Exception)
