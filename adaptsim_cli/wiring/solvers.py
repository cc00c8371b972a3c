"""Chooses the solver that trains the task policies of a session."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from adaptsim_cli.errors import UsageError

if TYPE_CHECKING:
    from sim.adaptation.checkpoint import Checkpoint
    from sim.solvers.solver import Expectations, Policies

SOLVERS = ("emulator", "naf")


@contextmanager
def solver_of(checkpoint: Checkpoint, name: str, workers: int, folder: Path) -> Iterator[tuple[Policies, Expectations]]:
    """The solver `name` (empty: the checkpoint's own), on `workers` processes (0: one per core).

    Only NAF simulates: it stores rollouts and policies in `folder`, which belongs to this session. Its settings are the
    checkpoint's, if that was made with NAF, else the paper's. Expectations come from the checkpoint.

    Raises UsageError for an unknown name and for a solver that the checkpoint does not contain, UnknownName for a task
    without NAF, CheckpointError if `folder` holds other data.
    """
    if name not in ("", *SOLVERS):
        raise UsageError(f"--solver {name}: choose one of {', '.join(SOLVERS)}")
    if name == "emulator" and checkpoint.naf:
        raise UsageError(
            f"--solver emulator: the checkpoint {checkpoint.path} was made with --solver naf and holds no emulator. "
            "Leave --solver out, or choose another checkpoint"
        )
    own = checkpoint.solver
    if name != "naf" and not checkpoint.naf:
        yield own, own
        return
    from sim.solvers.simulating import simulating

    with simulating("naf").in_session(own.task, checkpoint.naf, workers, folder) as solver:
        yield solver, solver if checkpoint.naf else own
