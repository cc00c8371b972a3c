"""Joins the parts of a benchmark: settings -> worlds, tables, checkpoints, jobs, results."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptsim_cli.config import Resolved
from adaptsim_cli.errors import UsageError
from adaptsim_cli.research.sealed import Seal, code_version, seal_of
from adaptsim_cli.research.working import StageProgress, working_in
from adaptsim_cli.research.world_tables import comma_separated, scene_keys, tables_folder

if TYPE_CHECKING:
    from sim.adaptation.checkpoint import Checkpoint
    from sim.research.benchmark.jobs import BenchmarkRow, Job
    from sim.research.benchmark.sessions import Conditions
    from sim.research.benchmark.strata import SealedSummary
    from sim.research.benchmark.summary import SetSummary
    from sim.research.benchmark.tables import WorldTable
    from sim.research.benchmark.worlds import BenchmarkWorld
    from sim.rollouts.recorded import RecordedTrials
    from sim.rollouts.run import StageProgress
    from sim.rollouts.shares import Share
    from sim.tasks.task import Task

FORMAT = 1
PAGE = "report.html"


@dataclass(frozen=True, eq=False)
class BenchmarkRequest:
    """A checked request for a benchmark."""

    resolved: Resolved
    task: Task
    targets: tuple[BenchmarkWorld, ...]
    methods: tuple[str, ...]
    conditions: Conditions
    seeds: int
    checkpoints: tuple[Checkpoint, ...]
    out: Path | None
    in_lab: bool = False  # trials run through the whole simulated lab
    recorded: RecordedTrials | None = None  # instead of targets
    left_out: tuple[tuple[str, str], ...] = ()  # for "all": methods missing from these checkpoints, and why
    seal: Seal | None = None  # of worlds that were drawn for this benchmark alone

    @property
    def plan(self) -> dict[str, Any]:
        """Everything that results depend on, and that may not change while they are gathered."""
        from adaptsim_cli.session.recorded.folder import digest

        plan = {
            "format": FORMAT,
            "task": self.task.name,
            "conditions": asdict(self.conditions),
            "checkpoints": [checkpoint.sha256 for checkpoint in self.checkpoints],
        }
        if self.recorded is not None:
            share = self.resolved.config.held_out
            return plan | {"trials": "recorded", "recorded": digest(self.recorded), "held_out": share}
        if self.in_lab or self.conditions.fresh:
            plan["trials"] = "lab" if self.in_lab else "simulated"
        return plan if self.seal is None else plan | {"sealed": {"seed": self.seal.seed, "commit": code_version()}}

    @property
    def folder(self) -> Path:
        """The folder of its results: the same request has the same folder."""
        if self.out is not None:
            return self.out.absolute()
        digest = hashlib.sha256(json.dumps(self.plan, sort_keys=True).encode()).hexdigest()[:8]
        name = f"{self.task.name}-budget{self.conditions.budget}-{digest}"
        return (self.resolved.places.benchmarks / name).absolute()


@dataclass(frozen=True, eq=False)
class Comparison:
    """A comparison and its results."""

    request: BenchmarkRequest
    tabled: bool  # whether trials were looked up in world tables
    rows: tuple[BenchmarkRow, ...]

    @property
    def targets(self) -> tuple[str, ...]:
        """The names of the worlds, or of the recordings."""
        return tuple(dict.fromkeys(row.target for row in self.rows))

    @cached_property
    def summaries(self) -> tuple[SetSummary, ...]:
        """One for each set of worlds."""
        from sim.research.benchmark.summary import summarise

        return summarise(self.rows)

    @cached_property
    def strata(self) -> SealedSummary | None:
        """The summary by strata, for sealed worlds, if everything that it needs was compared."""
        from sim.research.benchmark.strata import by_strata

        return None if self.request.seal is None else by_strata(self.rows)

    def as_json(self) -> dict[str, Any]:
        """The whole comparison, with one row per world, method and seed."""
        return {
            "trials": "tables" if self.tabled else "simulated",
            **self.request.plan,
            "targets": list(self.targets),
            "seeds": self.request.seeds,
            "left_out": dict(self.request.left_out),
            "rows": [asdict(row) for row in self.rows],
            "summary": [asdict(summary) for summary in self.summaries],
            "strata": None if self.strata is None else asdict(self.strata),
            "report": str(self.request.folder / PAGE),
        }


def request_of(
    resolved: Resolved,
    targets: str,
    methods: str,
    budget: int,
    fresh: int,
    seeds: int | None,
    checkpoints: str,
    out: Path | None,
    *,
    in_lab: bool = False,
) -> BenchmarkRequest:
    """Check the request before anything runs.

    Raises UsageError, UnknownName, WorldError, OutOfRange, CheckpointError, ExtraMissing.
    """
    from adaptsim_cli.bench.checkpoints import checkpoint_of, task_of
    from adaptsim_cli.session.recorded.comparison import compared
    from adaptsim_cli.session.recorded.folder import read_recorded
    from sim.adaptation.checkpoint import load_checkpoint
    from sim.adaptation.methods import method_names
    from sim.research.benchmark.entries import BEST_ACTION, LIMITS, Entry, entry_names
    from sim.research.benchmark.jobs import CONTROLS
    from sim.research.benchmark.sessions import Conditions
    from sim.research.benchmark.strata import SEALED_ENTRIES
    from sim.research.benchmark.worlds import targets_of, usual_targets
    from sim.tasks import get_task

    config = resolved.config
    task = get_task(config.task)
    seal = None if config.recorded else seal_of(resolved, targets)
    everything = (*method_names(), *((BEST_ACTION, *CONTROLS) if config.recorded else LIMITS))
    possible = everything if config.recorded else entry_names()
    usual = everything if seal is None else SEALED_ENTRIES
    chosen = usual if methods == "all" else tuple(dict.fromkeys(comma_separated(methods)))
    if unknown := [name for name in chosen if Entry.parse(name).name not in possible]:
        raise UsageError(f"--methods {','.join(unknown)}: choose all, or any of {', '.join(possible)}")
    if not chosen:
        raise UsageError(f"--methods is empty: choose all, or any of {', '.join(possible)}")
    loaded = tuple(load_checkpoint(task_of(config), name) for name in comma_separated(checkpoints))
    loaded = loaded or (checkpoint_of(config),)
    left_out = _left_out(chosen, loaded, config.recorded, wants_all=methods == "all")
    chosen = tuple(name for name in chosen if name not in left_out)
    seeds = _seeds(seeds, task, chosen, trained=len(loaded), recorded=config.recorded)
    conditions = Conditions(budget, config.particles, fresh=fresh)
    conditions.iterations(task)
    worlds: tuple[BenchmarkWorld, ...] = ()
    trials = None
    if config.recorded:
        if in_lab or fresh:
            raise UsageError("--recorded: trials are neither simulated nor run in the lab; leave out --lab and --fresh")
        trials = compared(read_recorded(task, Path(config.recorded)), loaded[0].solver)
    else:
        listed = comma_separated(targets) or usual_targets(task)
        worlds = targets_of(task, listed) if seal is None else seal.worlds(task)
        if in_lab:
            _require_lab(task, worlds)
    rest = tuple(left_out.items())
    return BenchmarkRequest(resolved, task, worlds, chosen, conditions, seeds, loaded, out, in_lab, trials, rest, seal)


def _left_out(
    entries: Sequence[str], checkpoints: Sequence[Checkpoint], recorded: str, *, wants_all: bool
) -> dict[str, str]:
    """The entries for which a checkpoint lacks something, and why. Raises CheckpointError unless all were wanted."""
    from sim.errors import CheckpointError
    from sim.research.benchmark.entries import Entry, require_entry
    from sim.research.benchmark.jobs import CONTROLS

    left_out = dict[str, str]()
    for text in entries:
        try:
            for checkpoint in checkpoints if text not in CONTROLS else ():
                require_entry(Entry.parse(text).name, checkpoint)
        except CheckpointError as error:
            if not wants_all:
                raise
            left_out[text] = str(error)
    return left_out


SEEDS = 10
"""Number of sessions of each method in each world, if seeds change anything."""


def _seeds(number: int | None, task: Task, methods: Sequence[str], *, trained: int, recorded: str) -> int:
    """The number of sessions of each method in each world; 1 by default if every seed would give the same ones.

    `trained` checkpoints are used in turn. Raises UsageError if identical sessions are requested.
    """
    from sim.adaptation.methods import ignores_seed
    from sim.research.benchmark.entries import LIMITS
    from sim.rollouts.draws import repeats_exactly

    same = all(ignores_seed(name, task) or (name in LIMITS and repeats_exactly(task)) for name in methods)
    if not same or trained > 1 or recorded:
        return SEEDS if number is None else number
    if number is not None and number > 1:
        raise UsageError(
            f"--seeds {number}: nothing is drawn in {task.name}, nor by {', '.join(methods)}, so every seed gives the "
            "same session. It is deterministic: one session is enough. Leave --seeds out, or add a method that draws, "
            "e.g. udr"
        )
    return 1


def benchmark(
    request: BenchmarkRequest, executor: Executor, progress: StageProgress, share: Share | None = None
) -> Comparison:
    """Run the missing sessions, or a share's. Raises DatasetError if a table is missing, SimError, SessionError."""
    from sim.research.benchmark.run import Results, run_jobs
    from sim.rollouts.executors import serial_executor

    tables = _tables(request)
    jobs = _jobs(request, tables) if request.recorded is None else _recorded_jobs(request, request.recorded)
    jobs = jobs if share is None else share.of(jobs)
    with (
        working_in(request.folder, "another benchmark is running in {}: wait for it, or give another --out", share),
        serial_executor() as here,
    ):
        if request.seal is not None:
            request.seal.open()
        results = Results(request.folder)
        results.agree(request.plan)
        # A recording is read once, and its sessions cost little: all run in this process.
        crew = executor if request.recorded is None else here
        rows = run_jobs(jobs, results, crew, lambda done, total: progress("sessions", done, total), _runner(request))
    return Comparison(request, any(table is not None for table in tables), tuple(rows))


def _runner(request: BenchmarkRequest) -> Callable[[Job], BenchmarkRow]:
    """The function that runs one job; the lab is imported only if trials run in it."""
    if request.in_lab:
        from adaptsim_cli.research.lab_place import run_in_lab

        return run_in_lab
    from sim.research.benchmark.jobs import run_job

    return run_job


def _require_lab(task: Task, targets: Sequence[BenchmarkWorld]) -> None:
    """Raises UsageError for a task without an arm, and for a world with physics that the lab does not have."""
    if task.hardware is None:
        raise UsageError(f"--lab: {task.name} has no motion for an arm, so the lab cannot run it; leave --lab out")
    if foreign := [target.name for target in targets if target.world.physics != "drake"]:
        raise UsageError(
            f"--lab: the lab is simulated in Drake, and {', '.join(foreign)} in another physics; leave them out"
        )


def _tables(request: BenchmarkRequest) -> list[WorldTable | None]:
    """The table of each target; None for a task that simulates its worlds."""
    from sim.research.benchmark.tables import load_table

    if request.task.exact or request.task.training:
        return [None] * len(request.targets)
    scenes, folder = scene_keys(request.task, request.targets), tables_folder(request.resolved)
    return [
        load_table(request.task, t.world, scenes[t.world.physics], folder / t.set / t.name) for t in request.targets
    ]


def _jobs(request: BenchmarkRequest, tables: Sequence[WorldTable | None]) -> list[Job]:
    """The jobs world by world, so that partial results are complete worlds."""
    from sim.research.benchmark.jobs import Job
    from sim.research.benchmark.tables import world_digest

    answers = [
        world_digest(request.task, target.world) if table is None else table.digest
        for target, table in zip(request.targets, tables, strict=True)
    ]
    return [
        Job(
            task=request.task.name,
            checkpoint=_found_again(request.checkpoints[seed % len(request.checkpoints)]),
            own_object=_own_object(request),
            set=target.set,
            target=target.name,
            answers=answer,
            method=method,
            seed=seed,
            conditions=request.conditions,
            world=target.world,
            table=table,
        )
        for target, table, answer in zip(request.targets, tables, answers, strict=True)
        for method in request.methods
        for seed in range(request.seeds)
    ]


def _recorded_jobs(request: BenchmarkRequest, trials: RecordedTrials) -> list[Job]:
    from adaptsim_cli.session.recorded.folder import digest
    from sim.research.benchmark.jobs import Job

    config, answers = request.resolved.config, digest(trials)[:16]
    return [
        Job(
            task=request.task.name,
            checkpoint=_found_again(request.checkpoints[seed % len(request.checkpoints)]),
            own_object=_own_object(request),
            set="recorded",
            target=Path(config.recorded).absolute().name,
            answers=f"{answers}-{config.held_out:g}",
            method=method,
            seed=seed,
            conditions=request.conditions,
            recorded=trials,
            held_out=config.held_out,
        )
        for method in request.methods
        for seed in range(request.seeds)
    ]


def _own_object(request: BenchmarkRequest) -> str:
    """The absolute path of the object's file, because workers run in another folder; empty without an object."""
    from sim.tasks.own_object import object_file

    config = request.resolved.config
    return str(object_file(config.task, config.object).absolute()) if config.object else ""


def _found_again(checkpoint: Checkpoint) -> str:
    """A shipped checkpoint by its name, any other by its absolute path, because workers run in another folder."""
    from sim.tasks import files_of

    is_shipped = checkpoint.path.is_relative_to(files_of(checkpoint.card.task, "checkpoints"))
    return checkpoint.path.name if is_shipped else str(checkpoint.path.absolute())
