"""The way to continue, as a hint at the error that stops a run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from adaptsim_cli.errors import DiskFull, Interrupted, PreflightFailed, StoppedByOperator
from hw.errors import HardwareError
from perception.errors import PerceptionError
from sim.errors import ClusterUnavailable, NotExecutable, RolloutError

_WORTH_CONTINUING = (
    StoppedByOperator,
    Interrupted,
    PreflightFailed,
    DiskFull,
    HardwareError,
    PerceptionError,
    NotExecutable,
    RolloutError,
    ClusterUnavailable,
    OSError,
)


@contextmanager
def how_to_continue(
    hint: str,
    interrupted: str = "interrupted; everything completed is stored",
    also: tuple[type[Exception], ...] = (),
) -> Iterator[None]:
    """Add `hint` to the error that stops a run, one of these or `also`; Ctrl-C becomes Interrupted(`interrupted`)."""
    explained: tuple[type[Exception], ...] = (*_WORTH_CONTINUING, *also)
    try:
        yield
    except KeyboardInterrupt as error:
        stopped = Interrupted(interrupted)
        stopped.add_note(hint)
        raise stopped from error
    except explained as error:
        error.add_note(hint)
        raise
