"""Which solver makes the task policies of a session."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from adaptsim_cli.errors import UsageError

if TYPE_CHECKING:
    from sim.adaptation.checkpoint import Checkpoint
    from sim.solvers.solver import Solver

SOLVERS = ("emulator", "naf")


@contextmanager
def solver_of(checkpoint: Checkpoint, name: str, workers: int, folder: Path) -> Iterator[Solver]:
    """The checkpoint's own solver where `name` is empty, on `workers` processes (0: one a core).

    The winners of an emulator are simulated. NAF keeps rollouts and policies in `folder`, which is the session's alone.

    Raises UsageError on an unknown name and where the checkpoint lacks what is asked for, UnknownName where a task has
    no NAF, CheckpointError where `folder` holds something else.
    """
    from sim.rollouts import process_pool, run_many
    from sim.rollouts.cache import CachedRollouts
    from sim.solvers.confirmation import confirming
    from sim.solvers.emulator.solver import EmulatorSolver
    from sim.solvers.naf.solver import NafSolver, session_naf

    if name not in ("", *SOLVERS):
        raise UsageError(f"--solver {name}: it is one of {', '.join(SOLVERS)}")
    made_with_naf = isinstance(checkpoint.solver, NafSolver)
    if name == "emulator" and made_with_naf:
        raise UsageError(
            f"--solver emulator: the checkpoint {checkpoint.path} was made with --solver naf and holds no emulator. "
            "Leave --solver out, or choose another checkpoint"
        )
    if name != "naf" and not isinstance(checkpoint.solver, EmulatorSolver | NafSolver):
        yield checkpoint.solver
        return
    with process_pool(workers or None) as crew:
        if name != "naf" and not made_with_naf:
            yield confirming(checkpoint.solver, partial(run_many, checkpoint.solver.task, executor=crew))
            return
        roll = CachedRollouts(checkpoint.solver.task, folder / "rollouts", crew)
        yield session_naf(checkpoint.solver, roll, folder / "policies")
