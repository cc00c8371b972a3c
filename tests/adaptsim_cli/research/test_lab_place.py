"""Trials of a benchmark in the whole simulated lab."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from adaptsim_cli import config
from adaptsim_cli.errors import UsageError
from adaptsim_cli.research import benchmarking as benchmark
from adaptsim_cli.research import lab_place
from adaptsim_cli.session.rig_target import RigTarget
from hw.types import Array
from perception.errors import ObjectNotFound
from sim.errors import RolloutError
from sim.lab.rollout import rollout_in
from sim.lab.world import load_world
from sim.research.benchmark.jobs import BenchmarkRow, Job
from sim.research.benchmark.sessions import Conditions
from sim.research.benchmark.trial_sources import TrialSource
from sim.tasks import get_task

PUSHING = get_task("pushing")


def job(method: str = "adaptsim") -> Job:
    """Its table is never asked here."""
    table: Any = object()
    world = load_world("wd", PUSHING)
    return Job("pushing", "default", "named", "wd", "0" * 16, method, 0, Conditions(budget=4), world, table)


@pytest.mark.long
def test_a_trial_in_the_lab_ends_near_that_of_a_rollout():
    action = PUSHING.action.denormalise(np.array([0.5, 0.5]))
    context = PUSHING.reference_context
    world = load_world("wd", PUSHING)
    with lab_place.in_lab(job()) as place:
        assert place.executable(context, action)
        seen = place.play(context[None], action[None], np.random.default_rng(0))
    alone = rollout_in(world, context, action)
    assert seen[0].end_state == pytest.approx(PUSHING.end_of(alone), abs=0.02)
    assert seen[0].reward == pytest.approx(PUSHING.score(alone, context), abs=0.1)
    assert seen[0].context == pytest.approx(context)


def test_an_object_that_is_never_found_is_moved_inward_and_then_ends_the_session_with_the_reason(monkeypatch):
    tried, placed = list[int](), list[Array]()

    def lost(_: object, drawn: Array, key: Any, operator: object) -> None:
        tried.append(key.attempt)
        placed.append(PUSHING.context.normalise(drawn))
        raise ObjectNotFound("no bottle in the picture")

    monkeypatch.setattr(RigTarget, "place", lost)
    with lab_place.in_lab(job()) as place, pytest.raises(RolloutError, match="no bottle in the picture"):
        place.play(PUSHING.context.low[None], np.array([[0.5, 0.0]]), np.random.default_rng(0))
    assert tried == list(range(lab_place.ATTEMPTS))
    inward = [np.full(len(PUSHING.context), lab_place.INWARD * attempt) for attempt in tried]
    np.testing.assert_allclose(placed, inward, atol=1e-12)


def test_only_methods_with_trials_go_to_the_lab(monkeypatch):
    went = list[tuple[str, TrialSource | None]]()

    def run(job: Job, trials: TrialSource | None = None) -> BenchmarkRow | None:
        went.append((job.method, trials))
        return None

    monkeypatch.setattr(lab_place, "run_job", run)
    for method in ("udr", "oracle", "best-action"):
        lab_place.run_in_lab(job(method))
    assert went == [("udr", None), ("oracle", None), ("best-action", None)]
    lab_place.run_in_lab(job("random"))
    assert isinstance(went[-1][1], lab_place.InLab)


def test_what_the_lab_cannot_run_is_refused(refused):
    assert "--lab: pendulum has no motion for an arm" in refused(
        2, "benchmark", "--task", "pendulum", "--lab", "--targets", "wd"
    )
    with pytest.raises(UsageError, match="mujoco-wd in another physics"):
        benchmark.request_of(config.load({"task": "pushing"}), "wd,mujoco-wd", "udr", 4, 0, 1, "", None, in_lab=True)


def test_results_of_the_lab_are_never_mixed_with_others():
    both = [
        benchmark.request_of(config.load({"task": "pushing"}), "wd", "udr", 4, 0, 1, "", None, in_lab=lab)
        for lab in (False, True)
    ]
    assert both[0].plan != both[1].plan
    assert both[0].folder != both[1].folder
