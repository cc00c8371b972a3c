"""Which solver makes the task policies of a session."""

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
    """Task policies as `name` says (empty: as the checkpoint has them), on `workers` processes (0: one a core).

    NAF alone simulates: it keeps rollouts and policies in `folder`, which is the session's alone; its rules are those
    of the checkpoint, if that was made with NAF, and otherwise the paper's. Expectations are the checkpoint's.

    Raises UsageError on an unknown name and where the checkpoint lacks what is asked for, UnknownName where a task has
    no NAF, CheckpointError where `folder` holds something else.
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
    from sim.rollouts import process_pool
    from sim.rollouts.cache import CachedRollouts
    from sim.solvers.naf.memory import NafMemory
    from sim.solvers.naf.solver import NafSolver, restore_naf, rules_of

    with process_pool(workers or None) as crew:
        roll, kept = CachedRollouts(own.task, folder / "rollouts", crew), folder / "policies"
        if checkpoint.naf:
            solver = restore_naf(own.task, checkpoint.naf, roll, kept)
            yield solver, solver
        else:
            yield NafSolver(own.task, roll, rules_of(own.task), NafMemory(own.task, kept)), own
