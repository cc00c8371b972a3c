"""Runs sessions, and commands of the program, on the toy rig in this process, and keeps what was said."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from toy_rig import ToyLab, opener, toy_parts

from adaptsim_cli import config
from adaptsim_cli.commands import app
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.release import Release
from adaptsim_cli.session import beginning, opening, running
from adaptsim_cli.session.flow import RunningSession
from adaptsim_cli.session.live_trial import PlannedTrial
from adaptsim_cli.session.operator import Choices, Operator, Review, Unattended
from adaptsim_cli.session.records import MotionRecord, TrialRecord
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import page
from sim.adaptation.stages import RunTrial

NAME = "toy-wd"


@dataclass
class ScriptedOperator:
    """Answers from a script: what to say of each reviewed trial, in order; accepts the rest."""

    reviews: list[Review] = field(default_factory=list)
    before_motion: Callable[[MotionRecord], None] = lambda _: None
    asked: list[str] = field(default_factory=list)

    def repeat_interrupted(self, stage: RunTrial) -> None:
        self.asked.append(f"repeat {stage.key.number}")

    def placed(self, what: str, wanted_m: np.ndarray, real: bool) -> None:
        self.asked.append(f"place the {what}")

    def approve(self, trial: MotionRecord, planned: PlannedTrial, real: bool, release: Release) -> None:
        self.asked.append(f"approve {trial.trial}")
        self.before_motion(trial)

    def rejected_already(self) -> str:
        return ""

    def review(self, tracked: TrialRecord, choices: Choices) -> Review:
        return self.reviews.pop(0) if self.reviews else Review()

    def decide(self, why: str, tracked: TrialRecord, choices: Choices) -> Review:
        self.asked.append(f"decide {tracked.trial}")
        return self.reviews.pop(0) if self.reviews else Review(rejected=why)

    def try_again(self, stage: RunTrial) -> bool:
        self.asked.append(f"again {stage.key.number}.{stage.key.attempt}")
        return True


def resolved(home: Path, **flags: object) -> config.Resolved:
    return config.load({"task": "toy", **flags}, {"ADAPTSIM_HOME": str(home)}, home)


def run(
    home: Path,
    lab: ToyLab | None = None,
    *,
    iterations: int = 1,
    kinds: Mapping[str, Any] | None = None,
    **flags: object,
) -> SessionStore:
    """`run-iteration --yes` on the toy rig, in this process; `kinds` are of `toy_parts`."""
    settings = resolved(home, **flags)
    request = running.SessionRequest(None, frozenset({"task"}), iterations, yes=True)
    running.run_session(settings, request, opener(lab or ToyLab(settings.config.seed), **kinds or {}), page.write)
    return SessionStore.open(settings.places.sessions, running.default_name(running.anywhere(settings.config)))


def attended(home: Path, operator: Operator, lab: ToyLab | None = None, name: str = "fake") -> RunningSession:
    """A new or continued session with an operator of one's own, ready for `run_iteration`."""
    settings = resolved(home)
    parts = toy_parts(lab or ToyLab(0), name)
    root = settings.places.sessions
    store = (
        SessionStore.open(root, NAME) if (root / NAME).is_dir() else beginning.begin(root, NAME, settings.config, parts)
    )
    return RunningSession(store, parts, operator, silent())


def summary(store: SessionStore, iteration: int) -> Any:
    """What `run-iteration --json` printed for an iteration, as the session keeps it."""
    *_, newest = sorted(store.iteration_folder(iteration).glob("result-*/summary.json"))
    return json.loads(newest.read_text())


def silent() -> Screen:
    return Screen(console=Console(file=io.StringIO(), width=80))


def unattended() -> Unattended:
    return Unattended(silent())


def no_space(_: int) -> None:
    raise OSError(28, os.strerror(28))


RUN = ("run-iteration", "--task", "toy", "--session", "s", "--yes", "--json")


def call(
    home: Path, command: Sequence[str], lab: ToyLab | None = None, out: io.StringIO | None = None, **kinds: Any
) -> tuple[int, str]:
    """Its exit code, and what it said on stderr, on one line; `out` gets its stdout, `kinds` are of `toy_parts`.

    Settings are those of the folder that `home` lies in.
    """
    said = io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        for name in [name for name in os.environ if name.startswith("ADAPTSIM_")]:
            patch.delenv(name)
        patch.setenv("ADAPTSIM_HOME", str(home))
        patch.chdir(home.parent)
        patch.setattr(opening, "open_parts", opener(lab or ToyLab(7), **kinds))
        with redirect_stdout(out or io.StringIO()), redirect_stderr(said):
            code = app.run(command)
    return code, " ".join(said.getvalue().split())
