"""Curves of a training, for whoever wants to watch."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tensorboardX import SummaryWriter

Log = Callable[[str, float, int], None]
"""(name, value, step)"""


def silent(name: str, value: float, step: int) -> None:
    """Nobody watches."""


@contextmanager
def tensorboard(folder: Path) -> Iterator[Log]:
    """Write event files into `folder` that TensorBoard opens: `tensorboard --logdir FOLDER`."""
    with SummaryWriter(logdir=str(folder)) as writer:
        yield writer.add_scalar
