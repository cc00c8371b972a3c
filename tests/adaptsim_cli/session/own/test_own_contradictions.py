"""An answer that contradicts its action is flagged at once, with the reading under which it would fit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from adaptsim_cli.bench.checkpoints import usual_checkpoint
from adaptsim_cli.screen.outputs.exchange import Question
from adaptsim_cli.screen.release import Release
from adaptsim_cli.session.folders import QUESTIONS
from adaptsim_cli.session.live_trial import PlannedTrial
from adaptsim_cli.session.own.exchange import Exchange
from adaptsim_cli.session.own.target import OwnTarget
from hw.types import Array
from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.sessions import Progress
from sim.adaptation.stages import TrialKey
from sim.tasks import get_task

PUSHING = get_task("pushing")
SOLVER = load_checkpoint(PUSHING, usual_checkpoint(PUSHING)).solver
ACTION = PUSHING.action.denormalise(np.array([0.8, 0.6]))


class TurnedPusher:
    """An answerer that reports one push of the simulator, with its way turned by R (2, 2)."""

    title, announcement, then = "a pusher", "The trial is asked for", ""
    moves = needs_consent = False

    def __init__(self, R: Array) -> None:
        self.R, self.release = R, Release()

    def ask(self, exchange: Exchange, question: Question, progress: Progress) -> None:
        middle = [space.denormalise(np.full((1, len(space)), 0.4)) for space in (PUSHING.parameters, PUSHING.nuisance)]
        paths = PUSHING.observation.denormalise(SOLVER.trajectories(middle[0], ACTION[None], middle[1]))
        places = np.vstack([PUSHING.require_hardware().standing.mark_m, paths[0], paths[0][-1:]])
        t_s = [0.0, *question.times_s, question.times_s[-1] + 0.2]
        state = np.c_[places[0] + (places - places[0]) @ self.R.T, np.full(len(t_s), 0.05)]
        table = {"trial": question.trial, "outcome": "upright", "t_s": t_s, "state": state.tolist()}
        exchange.answer_file.write_text(json.dumps(table))


@pytest.mark.parametrize(
    ("R", "words"),
    [(np.eye(2), ""), (np.array([[0.0, -1.0], [1.0, 0.0]]), "only if the states are turned by -90° about z")],
    ids=["sound", "turned by 90°"],
)
def test_the_first_answer_is_compared_with_its_action(tmp_path: Path, R: Array, words: str) -> None:
    (tmp_path / QUESTIONS).mkdir()
    target = OwnTarget(PUSHING, tmp_path, TurnedPusher(R), "adaptsim", SOLVER)
    context = PUSHING.context.denormalise(np.full(len(PUSHING.context), 0.5))
    flags = target.execute(PlannedTrial(context, context, TrialKey(1, 0), ACTION)).trajectory.flags
    named = [flag for flag in flags if flag.startswith("this answer contradicts its action: ")]
    assert [words in flag for flag in named] == ([True] if words else [])
