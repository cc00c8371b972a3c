"""Loggers that a lab has already: TensorBoard, Weights & Biases, MLflow, and those of installed packages.

A package offers one by an entry point of the group `adaptsim.loggers`: its name, and a module with `open_logger`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol

from adaptsim_cli.errors import UsageError
from hw.plugins import Registry

Words = Mapping[str, str | int]
Values = Mapping[str, float]


class SessionLogger(Protocol):
    """Keeps one session. Steps are numbers of trials; names have a group before a slash, e.g. `parameter/mu`."""

    opened_by: str
    """The shell command that shows the log on this computer; empty: none."""

    def values(self, step: int, values: Values) -> None:
        """Keep numbers by name."""

    def words(self, step: int, name: str, text: str) -> None:
        """Keep a sentence."""

    def picture(self, step: int, name: str, jpeg: bytes) -> None:
        """Keep a picture."""

    def close(self) -> None:
        """Write everything that is not written yet."""


OpenLogger = Callable[[Path, str, Words], SessionLogger]
"""(an empty folder of its own, name of the session, its settings) -> a logger. Raises ExtraMissing."""

OURS = {name: f"adaptsim_cli.show.loggers.{name}_log" for name in ("tensorboard", "wandb", "mlflow")}

LOGGERS = Registry[OpenLogger](
    label="logger", group="adaptsim.loggers", attribute="open_logger", ours=OURS, error=UsageError
)
