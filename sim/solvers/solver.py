"""The task policy of a distribution of parameters, by any solver (their contract: `Solver` in `sim.tasks.task`).

Solvers: `sim.solvers.emulator.network`, a task's own exact one (`Task.exact`), and NAF's in `sim.research.naf`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from hw.types import Array

if TYPE_CHECKING:
    from sim.tasks.task import Executable, Policies, SolvedPolicy


def policy_for(policies: Policies, samples: Array, executable: Executable | None = None, seed: int = 0) -> SolvedPolicy:
    """The task policy for the distribution of parameters that `samples` (m, p) stand for.

    Its draws are the same every time. If many actions look equally good to a solver, its draws decide between them,
    although the actions may differ in reality. So the same distribution always has the same policy, and the final
    policy of a session is one that it has tried.
    """
    return policies.policies(np.asarray(samples)[None], np.random.default_rng(seed), executable)[0]


def naf() -> Any:
    """The module of NAF with `restore` and `in_session`, which simulates on demand. It is imported on first use."""
    return import_module("sim.research.naf.solver")
