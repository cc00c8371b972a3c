"""Logs the curves of a training."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tensorboardX import SummaryWriter

Log = Callable[[str, float, int], None]
"""(name, value, step)"""


def silent(name: str, value: float, step: int) -> None:
    """A log that stores nothing."""


@contextmanager
def tensorboard(folder: Path) -> Iterator[Log]:
    """Write event files for TensorBoard into `folder`: `tensorboard --logdir FOLDER`."""
    with SummaryWriter(logdir=str(folder)) as writer:
        yield writer.add_scalar
