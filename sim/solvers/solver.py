"""What learning asks of the simulator's answers: task policies, and what they earn.

Three siblings: `sim.solvers.emulator.solver`, `sim.solvers.naf.solver`, and a task's own exact one (`Task.exact`).
"""

from __future__ import annotations

import numpy as np

from hw.types import Array
from sim.tasks.solver import Executable, SolvedPolicy, SolverOf, SolverSettings
from sim.tasks.task import Task

__all__ = ["Executable", "SolvedPolicy", "Solver", "SolverSettings", "policy_for"]

Solver = SolverOf[Task]
"""The contract that all solvers keep."""


def policy_for(solver: Solver, samples: Array, executable: Executable | None = None, seed: int = 0) -> SolvedPolicy:
    """The task policy for the distribution of parameters that `samples` (m, p) stand for.

    Drawn alike every time: where many actions look equally good to a solver its draws decide between them, and reality
    need not agree. So the same distribution has the same policy, and what a session goes with is what it has tried.
    """
    return solver.policies(np.asarray(samples)[None], np.random.default_rng(seed), executable)[0]
