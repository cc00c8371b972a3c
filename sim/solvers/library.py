"""Tasks that train their policies: the library of Phase 1, and the solver that chooses among its members."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, as_completed, wait
from dataclasses import replace
from pathlib import Path

import numpy as np

from hw.types import Array
from sim.rollouts.draws import cover
from sim.rollouts.executors import process_pool
from sim.rollouts.run import Progress
from sim.rollouts.shards import simulate_missing, split
from sim.rollouts.shares import Share
from sim.solvers.candidates import ListedActionSolver
from sim.solvers.grid import PROBES, draws_of, grid_behind, grid_of
from sim.tasks.library import LibraryRollouts, PolicyLibrary, library_of
from sim.tasks.members import POLICY, Member, read_member, train_member
from sim.tasks.task import Task

SAMPLES, EVERYWHERE = 16, 64
"""Number of draws of parameters for training one member, and for training the member for all of Omega."""

SPREAD = 0.5
"""Standard deviation of the parameters for which a member is trained, as a share of D, the distance up to which it is
reused."""

ROLLOUTS = 2048
"""Number of rollouts of all members together at the points of the grid of parameters, which has at most 256 points."""


def with_library(task: Task, library: PolicyLibrary) -> Task:
    """The task whose actions are the members of the library."""
    base = task.simulate.task if isinstance(task.simulate, LibraryRollouts) else task
    return replace(base, simulate=LibraryRollouts(base, library), simulate_many=None, exact=library_solver)


def library_solver(task: Task) -> ListedActionSolver:
    """The solver of a task `with_library`: policies choose among its members, by true rollouts on a grid."""
    library = library_of(task)
    assert library is not None
    assert task.training is not None
    points = max(16, min(256, ROLLOUTS // (task.training.policies * draws_of(task))))
    grid = grid_of(task, points, library.places[:PROBES])
    return ListedActionSolver(task, grid, library.places)


def train_library(task: Task, folder: Path, seed: int, executor: Executor, progress: Progress) -> PolicyLibrary:
    """Train the missing members in `folder`: the first for all of Omega, the others at points that fill it evenly.

    Raises TaskError if a training fails.
    """
    return PolicyLibrary(_trained(_orders(task, folder, seed), executor, progress))


def train_share(task: Task, folder: Path, seed: int, share: Share, executor: Executor, progress: Progress) -> bool:
    """Train the missing members of one share of the library, and say whether all members are there now.

    Raises TaskError if a training fails.
    """
    orders = _orders(task, folder, seed)
    _trained(share.of(orders), executor, progress)
    return all((order[-1] / POLICY).exists() for order in orders)


Order = tuple[Task, str, Array, Array, int, Path]
"""The arguments of `train_member`."""


def _orders(task: Task, folder: Path, seed: int) -> list[Order]:
    """The members of a library: the first for all of Omega, the others at points that fill it evenly."""
    assert task.training is not None
    count = task.training.policies
    rng = np.random.default_rng(seed)
    places = np.concatenate([task.parameters.middle[None], cover(task.parameters, count - 1, rng)])
    seeds = [int(s) for s in rng.integers(2**31, size=count)]
    samples = [cover(task.parameters, EVERYWHERE, rng), *(_near(task, place, rng) for place in places[1:])]
    return [(task, _name(i), samples[i], places[i], seeds[i], folder / _name(i)) for i in range(count)]


def _trained(orders: Sequence[Order], executor: Executor, progress: Progress) -> tuple[Member, ...]:
    progress(0, len(orders))
    jobs = [executor.submit(train_member, *order) for order in orders]
    try:
        for done, job in enumerate(as_completed(jobs), start=1):
            job.result()
            progress(done, len(orders))
    finally:
        for job in jobs:
            job.cancel()
    return tuple(job.result() for job in jobs)


def _name(number: int) -> str:
    return "everywhere" if number == 0 else f"policy-{number:03d}"


def _near(task: Task, place: Array, rng: np.random.Generator) -> Array:
    assert task.training is not None
    std = SPREAD * task.training.distance
    unit = task.parameters.normalise(place) + std * rng.standard_normal((SAMPLES, len(place)))
    return task.parameters.denormalise(np.clip(unit, 0.0, 1.0))


def trained_within(
    task: Task, trained_for: Array, folder: Path, limit_s: float, waiting: Callable[[float], None]
) -> Member | None:
    """The policy for parameters (p,), trained in a process of its own and stored as `folder`; None after `limit_s`.

    A note is kept of a training that was stopped, and it is not begun again. `waiting` gets the seconds so far. Raises
    TaskError if the training fails.
    """
    note = folder.with_name(f"{folder.name}.stopped")
    if not (folder / POLICY).exists():
        if note.exists():
            return None
        rng = np.random.default_rng(int(folder.name.rpartition("-")[2], 16))
        seed, samples = int(rng.integers(2**31)), _near(task, trained_for, rng)
        with process_pool(1) as crew:
            job = crew.submit(train_member, task, folder.name, samples, trained_for, seed, folder)
            began = time.monotonic()
            while not job.done() and time.monotonic() - began < limit_s:
                wait([job], timeout=min(0.5, limit_s))
                waiting(time.monotonic() - began)
            if not job.done():
                for process in list((crew._processes or {}).values()):
                    process.kill()
                folder.parent.mkdir(parents=True, exist_ok=True)
                note.write_text(f"stopped after {limit_s:g} s\n", encoding="utf-8")
                return None
            job.result()
    return read_member(folder)


def name_for(trained_for: Array) -> str:
    """The name of a policy that a session trains for parameters (p,)."""
    return f"session-{hashlib.sha256(np.ascontiguousarray(trained_for).tobytes()).hexdigest()[:8]}"


def grown(
    solver: ListedActionSolver, members: Sequence[Member], folder: Path, executor: Executor, progress: Progress
) -> ListedActionSolver:
    """The solver with further members, whose rollouts at the grid are simulated and kept in `folder`."""
    library, old = library_of(solver.task), grid_behind(solver)
    assert library is not None
    assert old is not None
    more = library_solver(with_library(solver.task, PolicyLibrary((*library.members, *members))))
    grid = grid_behind(more)
    assert grid is not None
    if stored := old.tensors:
        grid.restore(stored)
    for member in members:
        action = member.trained_for[None]
        requests = grid.requests(action)
        if len(requests):
            shards = split(requests, len(requests), lambda _, name=member.name: folder / f"{name}.npz")  # type: ignore[misc]
            grid.take(action, simulate_missing(more.task, shards, executor, progress))
    return more
