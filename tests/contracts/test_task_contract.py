"""What every registered task promises to everything that learns, stores or talks to an operator."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from perception.types import Outcome
from sim.errors import NoHardware
from sim.lab.world import list_worlds, load_world
from sim.rollouts.recorded import scores_only
from sim.tasks import TASKS, get_task, task_of_file
from sim.tasks.fingerprint import fingerprint
from sim.tasks.task import Task

EXACT = [name for name in sorted(TASKS) if get_task(name).exact is not None]
MIRRORED = [name for name in sorted(TASKS) if get_task(name).mirror is not None]


FILES = Path(__file__).parents[1] / "data/own_simulator"
"""Tasks of one file; one of them needs MuJoCo."""
OF_FILES = [(FILES / "shuffle.py", "shuffle"), (FILES / "settle.py", "settle")]


@pytest.fixture(params=[*sorted(TASKS), *(name for _, name in OF_FILES)])
def task(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Task:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    for path, name in OF_FILES:
        if name == request.param:
            return task_of_file(str(path))
    return get_task(request.param)


def draw(task: Task, seed: int) -> tuple[np.ndarray, ...]:
    """Parameters, context, action, nuisance."""
    rng = np.random.default_rng(seed)
    spaces = (task.parameters, task.context, task.action, task.nuisance)
    return tuple(space.spread(rng.random(len(space))) for space in spaces)


@pytest.mark.parametrize("name", MIRRORED)
def test_a_mirrored_rollout_ends_like_the_mirror_image_of_the_rollout(name: str) -> None:
    task = get_task(name)
    mirror, times_s = task.mirror, task.observation.times_s
    assert mirror is not None
    assert mirror.keeps(task.parameters)
    assert mirror.keeps(task.margin)
    for seed in (0, 1, 2):
        parameters, context, action, nuisance = draw(task, seed)
        straight = task.simulate(parameters, context, action, nuisance)
        turned = task.simulate(
            parameters * mirror.parameters, context, action * mirror.action, nuisance * mirror.nuisance
        )
        assert turned.outcome is straight.outcome
        columns = list(task.observation.columns)
        apart = turned.at(times_s)[:, columns] - straight.at(times_s)[:, columns] * mirror.observed
        assert np.abs(apart / (task.observation.high - task.observation.low)).max() < 0.005
        assert np.allclose(task.end_state(turned), task.end_state(straight) * mirror.end_state, atol=0.005)


def test_names_and_sizes_agree(task: Task) -> None:
    assert get_task(task.name) is task
    assert task.parameters.names == task.margin.names
    assert task.action_noise.shape == (len(task.action),)
    assert task.reference_context.shape == (len(task.context),)
    assert task.observation.low.shape == task.observation.high.shape == (len(task.observation.columns),)
    assert len(fingerprint(task)) == 16
    for inner, outer in zip(task.parameters.dimensions, task.margin.dimensions, strict=True):
        assert outer.low <= inner.low < inner.high <= outer.high


def test_a_rollout_repeats_exactly_and_is_scored_between_0_and_1(task: Task) -> None:
    for seed in (0, 1):
        parameters, context, action, nuisance = draw(task, seed)
        one = task.simulate(parameters, context, action, nuisance)
        two = task.simulate(parameters, context, action, nuisance)
        assert np.array_equal(one.state, two.state)
        assert one.outcome is two.outcome
        assert isinstance(one.outcome, Outcome)
        assert np.isfinite(one.state).all()
        seen = task.observation(one)
        assert seen.shape == (task.observation.size,)
        assert np.isfinite(seen).all()
        assert 0.0 <= task.score(one, context) <= 1.0


def test_rewards_of_successes_take_stacks(task: Task) -> None:
    parameters, context, action, nuisance = draw(task, 2)
    end = np.atleast_1d(task.end_state(task.simulate(parameters, context, action, nuisance)))
    end = np.where(np.isfinite(end), end, 0.0)
    single = task.reward_of_success(end, context)
    stacked = task.reward_of_success(np.tile(end, (3, 2, 1)), np.tile(context, (2, 1)))
    assert stacked.shape == (3, 2)
    assert np.allclose(stacked, single)


def test_observations_at_the_reference_context_stay(task: Task) -> None:
    seen = np.linspace(0.1, 0.9, task.observation.size)
    assert np.allclose(task.at_context(seen, task.reference_context), seen)


def test_a_task_has_worlds_and_default_effects(task: Task) -> None:
    names = list_worlds(task)
    assert names
    for name in names:
        assert load_world(name, task).parameters.shape == (len(task.parameters),)
    assert dataclasses.is_dataclass(task.unmodelled())


@pytest.mark.parametrize("name", EXACT)
def test_an_exact_solver_expects_what_rollouts_earn(name: str) -> None:
    task = get_task(name)
    assert task.exact is not None
    solver, rng = task.exact(task), np.random.default_rng(3)
    targets, contexts = task.parameters.sample(rng, 4), task.context.sample(rng, 1)
    policies = solver.policies(task.parameters.sample(rng, 4)[:, None], rng)
    actions = np.stack([policy.actions(contexts) for policy in policies])
    nuisance = task.nuisance.sample(rng, 4)
    expected = solver.expected_rewards(targets, contexts, actions, rng)
    tracks = [task.simulate(t, contexts[0], a[0], n) for t, a, n in zip(targets, actions, nuisance, strict=True)]
    assert np.allclose(expected, [task.score(track, contexts[0]) for track in tracks], atol=1e-9)
    everywhere = np.tile(contexts, (4, 1))
    paths = solver.trajectories(targets, actions[:, 0], nuisance, everywhere)
    assert np.allclose(paths, [task.observation(track) for track in tracks], atol=1e-9)


@pytest.mark.parametrize("name", sorted(TASKS))
def test_each_of_our_tasks_declares_what_a_lab_reports(name: str) -> None:
    assert get_task(name).report is not None


def test_what_a_lab_reports_of_a_trial_is_what_the_simulator_reports(task: Task) -> None:
    report = task.report
    if report is None:  # a task may leave it out, and then says so
        with pytest.raises(NoHardware, match=f"the task {task.name} does not say what a lab reports"):
            task.require_report()
        return
    assert set(report.successes) <= set(report.outcomes)
    ended = set()
    for seed in range(3):
        parameters, context, action, nuisance = draw(task, seed)
        track = task.simulate(parameters, context, action, nuisance)
        assert track.state.shape[1] == len(report.columns)
        ended.add(track.outcome)
        for outcome in report.outcomes:
            changed = dataclasses.replace(track, outcome=outcome)
            assert task.succeeded(changed) == (outcome in report.successes)
        without = dataclasses.replace(track, outcome=report.successes[0], end_in_tool_m=np.full(3, np.nan))
        assert np.isfinite(task.score(without, context)) is not report.ends_in_tool
    assert ended - {Outcome.SOLVER_FAILED} <= set(report.outcomes)
    assert all(column in report.columns for column in report.computed)
    if len(task.context):
        assert report.places_first is not scores_only(task)
    if report.computed:
        with pytest.raises(NoHardware, match=f"the task {task.name} does not fit a robot of your own.*only its sim"):
            task.require_report()
    else:
        assert task.require_report() is report


def test_moments_that_were_not_watched_are_missing_and_count_for_nothing(task: Task) -> None:
    track = task.simulate(*draw(task, 0))
    times_s = task.observation.times_s
    late = dataclasses.replace(track, watched_s=(float(times_s[2]), float(times_s[-2])))
    whole, seen = task.observation(track), task.observation(late)
    missing = np.isnan(seen).reshape(len(times_s), -1)
    assert [bool(row.all()) for row in missing] == [t < times_s[2] or t > times_s[-2] for t in times_s]
    assert np.array_equal(seen[np.isfinite(seen)], whole[np.isfinite(seen)])
