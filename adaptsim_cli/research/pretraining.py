"""Joins the parts of Phase 1: settings -> budget, executor, folder; and tests finished checkpoints."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptsim_cli.bench.checkpoints import checkpoint_of, task_of
from adaptsim_cli.config import LEARNT, Config, Resolved
from adaptsim_cli.errors import UsageError
from adaptsim_cli.research.working import StageProgress, working_in

if TYPE_CHECKING:
    from sim.research.pretraining.budget import OptionalStages, PretrainBudget
    from sim.rollouts.run import StageProgress
    from sim.rollouts.shares import Share
    from sim.tasks.task import Task

ROLLOUTS, QUICK = 240, 96
"""Numbers of true rollouts of a verification: the usual one takes half a minute of one core, the short one about ten
seconds."""


@dataclass(frozen=True)
class RequestedSizes:
    """Requested sizes; None: the budget's."""

    rollouts: int | None = None  # of the dataset, spread evenly over the space
    denser: int | None = None  # further ones where the outcome is uncertain
    episodes: int | None = None  # of the training of each adaptation policy
    judged: int | None = None  # unseen targets of the evaluation

    def applied_to(self, budget: PretrainBudget) -> PretrainBudget:
        """The budget with these sizes."""
        return replace(
            budget,
            rollouts=_either(self.rollouts, budget.rollouts),
            denser=_either(self.denser, budget.denser),
            meta=replace(budget.meta, episodes=_either(self.episodes, budget.meta.episodes)),
            evaluation=replace(budget.evaluation, targets=_either(self.judged, budget.evaluation.targets)),
        )

    @property
    def label(self) -> str:
        """Part of the folder's name; empty if no size was requested."""
        sizes = {
            "": self.rollouts,
            "denser": self.denser,
            "episodes": self.episodes,
            "judged": self.judged,
        }
        return "-".join(f"{what}{size}" for what, size in sizes.items() if size is not None)


def _either(size: int | None, usual: int) -> int:
    return usual if size is None else size


@dataclass(frozen=True)
class Request:
    """A checked request for a pretraining."""

    task: Task
    solver: str
    budget: PretrainBudget
    seed: int
    folder: Path


BUSY = "another pretraining is running in {}: wait for it, or give another --out"


def pretrain(request: Request, executor: Executor, progress: StageProgress, stages: OptionalStages) -> Path:
    """Run Phase 1; return the checkpoint's folder. Resumes a run in the request's. Raises SimError, SessionError."""
    from sim.research.pretraining.pipeline import pretrain

    with working_in(request.folder, BUSY):
        return pretrain(
            request.task, request.folder, request.budget, request.seed, executor, progress, request.solver, stages
        )


def pretrain_share(request: Request, share: Share, executor: Executor, progress: StageProgress) -> bool:
    """Simulate one share of the dataset or of the grid. Returns whether it is complete; False while it waits for
    others.

    Raises UsageError if there is no dataset to simulate, SimError, SessionError.
    """
    from sim.research.pretraining.dataset_share import agree_on_plan, simulate_dataset_share, stage_seeds
    from sim.research.pretraining.grid_stage import simulate_grid_share

    task, folder = request.task, request.folder
    refusal = "--share divides the rollouts of a pretraining, and this one has none to divide: leave it out"
    if request.solver != LEARNT[0]:
        raise UsageError(refusal)
    with working_in(folder, BUSY, share):
        if not (task.exact or task.training):
            return simulate_dataset_share(task, folder, request.budget, request.seed, share, executor, progress)
        agree_on_plan(task, folder, request.budget, request.seed, request.solver)
        complete = simulate_grid_share(task, folder, stage_seeds(request.seed)[0], share, executor, progress)
    if complete is None:
        raise UsageError(refusal)
    return complete


def checked(resolved: Resolved, out: Path | None, budget: str, targets: str, sizes: RequestedSizes) -> Request:
    """The request with the settings' task, solver and seed.

    Raises UsageError on an unknown budget, solver or kind of targets, SimError.
    """
    from sim.research.pretraining.budget import PretrainBudget
    from sim.research.pretraining.meta_training import TARGETS

    budgets = {"full": PretrainBudget.full, "small": PretrainBudget.small}
    if budget not in budgets:
        raise UsageError(f"--budget {budget}: choose one of {', '.join(budgets)}")
    config = resolved.config
    solver = config.solver or LEARNT[0]
    if solver not in LEARNT:
        raise UsageError(f"--solver {solver}: choose one of {', '.join(LEARNT)}")
    kind = next((one for one in TARGETS if one == targets), None)
    if kind is None:
        raise UsageError(f"--targets {targets}: choose one of {', '.join(TARGETS)}")
    task = task_of(config)
    chosen = sizes.applied_to(budgets[budget](task).on_targets(kind))
    unusual = (
        Path(config.object).stem,
        solver if solver != LEARNT[0] else "",
        targets if targets != TARGETS[0] else "",
        budget,
        sizes.label,
    )
    parts = (task.name, *(part for part in unusual if part), f"seed{config.seed}")
    folder = (out or resolved.places.pretraining / "-".join(parts)).absolute()
    return Request(task, solver, chosen, config.seed, folder)


def to_learn(config: Config, rollouts: int | None) -> int:
    """How many rollouts the object of the settings needs before its checkpoint is made; 0 inside of the margin."""
    from sim.research.pretraining.for_object import rollouts_of
    from sim.tasks import get_task

    return rollouts_of(task_of(config), get_task(config.task), rollouts)


def object_ready(
    resolved: Resolved, config: Config, rollouts: int | None, executor: Executor, progress: StageProgress
) -> dict[str, Any]:
    """Make the checkpoint of the settings' object, and return what `adaptsim object` prints about it, for JSON.

    Raises SimError, SessionError.
    """
    from sim.adaptation.checkpoint import load_checkpoint
    from sim.research.pretraining.for_object import is_inside, make_ready
    from sim.tasks import get_task

    task, usual = task_of(config), get_task(config.task)
    folder = (resolved.places.pretraining / f"{task.name}-{Path(config.object).stem}-object").absolute()
    with working_in(folder, "another command works on this object in {}: wait for it"):
        path, held_out = make_ready(task, load_checkpoint(usual), folder, config.seed, executor, progress, rollouts)
    parameters = tell_parameters(config, lambda done, total: progress("sessions", done, total))
    return {
        "inside": is_inside(task, usual),
        "checkpoint": str(path),
        "held_out": None if held_out is None else asdict(held_out),
        "parameters": parameters["parameters"],
    }


def verify_figures(config: Config, rollouts: int, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Load the settings' checkpoint, compare it with card and task, and measure the card's figures again; for JSON.

    Raises CheckpointError if it is corrupt or of another task. `holds` says whether the figures hold.
    """
    from sim.research.pretraining.verification import CardFigure
    from sim.research.pretraining.verification import verify_figures as verify
    from sim.rollouts.executors import simulating_executor
    from sim.rollouts.run import run_many

    checkpoint = checkpoint_of(config)
    task = checkpoint.solver.task
    figures: list[CardFigure] = []
    if rollouts:
        with simulating_executor(config.workers) as executor:
            roll = partial(run_many, task, executor=executor)
            figures = verify(checkpoint, roll, rollouts, config.seed, progress)
    return {
        "task": task.name,
        "folder": str(checkpoint.path),
        "sha256": checkpoint.sha256,
        "holds": all(f.holds for f in figures),
        "figures": [
            {
                "name": figure.name,
                "card": figure.card,
                "found": figure.measured,
                "tolerance": figure.tolerance,
                "better": figure.better,
                "holds": figure.holds,
            }
            for figure in figures
        ],
    }


def checkpoint_card(task: str, folder: Path) -> dict[str, Any]:
    """The card of a checkpoint, ready for JSON: null for a figure that is not a number. Raises CheckpointError."""
    from sim.adaptation.card import read_card

    text = json.dumps(read_card(folder, task).facts(), default=str)
    card: dict[str, Any] = json.loads(text, parse_constant=lambda _: None)
    return card


def tell_trials(config: Config, *, anew: bool, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """How many trials a session with the settings' checkpoint needs, for JSON; kept in its folder.

    Raises CheckpointError.
    """
    from sim.adaptation.trials_forecast import load, save
    from sim.adaptation.trials_needed import forecast as imagined

    checkpoint = checkpoint_of(config)
    forecast, is_kept = None if anew else load(checkpoint.path, checkpoint.sha256), True
    if forecast is None:
        forecast = imagined(checkpoint, seed=config.seed, progress=progress)
        try:
            save(forecast, checkpoint.path)
        except OSError:  # an installed package may be read-only
            is_kept = False
    return {"folder": str(checkpoint.path), "is_kept": is_kept, "forecast": forecast}


def tell_parameters(config: Config, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Which parameters a session with the settings' checkpoint can identify, for JSON. Raises CheckpointError."""
    from sim.adaptation.methods.adaptsim import create
    from sim.research.identifiability import SESSIONS, TRIALS, errors_left, in_words

    checkpoint = checkpoint_of(config)
    task = checkpoint.solver.task
    left = errors_left(create(task, checkpoint).simulators, config.seed, progress)
    return {
        "folder": str(checkpoint.path),
        "task": task.name,
        "sessions": SESSIONS,
        "trials": TRIALS,
        "parameters": [
            {"name": d.name, "title": d.title, "left": one, "words": in_words(one)}
            for one, d in zip(left.tolist(), task.parameters.dimensions, strict=True)
        ],
    }
