"""Adds the command to continue to every error that stops a run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from adaptsim_cli.errors import DiskFull, Interrupted, PreflightFailed, StoppedByOperator
from hw.errors import HardwareError
from perception.errors import PerceptionError
from sim.errors import ClusterUnavailable, NotExecutable, RolloutError, SolverFailed

_WORTH_CONTINUING = (
    StoppedByOperator,
    Interrupted,
    PreflightFailed,
    DiskFull,
    HardwareError,
    PerceptionError,
    NotExecutable,
    SolverFailed,
    RolloutError,
    ClusterUnavailable,
    OSError,
)


@contextmanager
def how_to_continue(hint: str, interrupted: str = "interrupted; everything completed is stored") -> Iterator[None]:
    """Add `hint` to the error that stops a run; Ctrl-C becomes Interrupted with the message `interrupted`."""
    try:
        yield
    except KeyboardInterrupt as error:
        stopped = Interrupted(interrupted)
        stopped.add_note(hint)
        raise stopped from error
    except _WORTH_CONTINUING as error:
        error.add_note(hint)
        raise
