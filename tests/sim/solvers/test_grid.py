"""The grid solver and the choice among listed actions, on a toy: a stone that slides until friction stops it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hw.types import Array, frozen_array
from perception.types import ObjectTrack, Outcome
from sim.adaptation.method import Trial
from sim.adaptation.outcome_posterior import OutcomePosterior
from sim.adaptation.reward_table import RewardTable
from sim.adaptation.simulators import Simulators
from sim.errors import NotExecutable
from sim.rollouts.executors import serial_executor
from sim.rollouts.run import run_many
from sim.solvers.candidates import with_listed_actions
from sim.solvers.grid import GRID, NUISANCES, grid_behind, grid_solver
from sim.tasks.pendulum import TASK as PENDULUM
from sim.tasks.task import Observation, Task
from sim.types import Dimension, Space

CALLS: list[float] = []


def slide(parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: object = None) -> ObjectTrack:
    CALLS.append(float(action[0]))
    end = action[0] / parameters[0]
    return ObjectTrack(np.array([0.0, 1.0]), np.array([[0.0], [end]]), Outcome.SETTLED, np.full(3, np.nan), np.ones(2))


TASK: Task = replace(
    PENDULUM,
    name="stone",
    parameters=Space((Dimension("mu", "", 1.0, 2.0),)),
    margin=Space((Dimension("mu", "", 1.0, 2.0),)),
    context=Space((Dimension("goal", "m", 0.0, 1.0),)),
    action=Space((Dimension("speed", "m/s", 0.0, 1.0),)),
    action_noise=frozen_array([0.0]),
    observation=Observation(
        times_s=frozen_array([0.0, 1.0]),
        columns=(0,),
        low=frozen_array([0.0]),
        high=frozen_array([1.0]),
        noise_mean=frozen_array([0.0]),
        noise_std=frozen_array([0.001]),
        curves=("x [m]",),
    ),
    simulate=slide,
    simulate_many=None,
    reference_context=frozen_array([0.5]),
    end_state=lambda track: track.state[-1],
    succeeded=lambda track: True,
    reward_of_success=lambda end, context: np.maximum(0.0, 1.0 - np.abs(end[..., 0] - context[..., 0])),
    exact=grid_solver,
)


def test_a_pair_of_parameters_and_action_is_simulated_once_and_answers_for_the_nearest_point() -> None:
    solver, nothing = grid_solver(TASK), np.zeros(0)
    CALLS.clear()
    points = solver.behind.points  # type: ignore[attr-defined]
    near = np.array([[1.5], [1.5001], [1.9]])
    predicted = solver.outcomes(near, np.array([[0.4]]), nothing, TASK.reference_context)
    success, end = predicted.success, predicted.end_state
    closest = points[np.abs(points[:, 0][None] - near).argmin(axis=1), 0]
    assert end[0, :, 0] == pytest.approx(0.4 / closest)
    assert success.tolist() == [[1.0, 1.0, 1.0]]
    assert len(CALLS) == len(set(closest.tolist())) == 2
    solver.outcomes(near, np.array([[0.4]]), nothing, TASK.reference_context)
    assert solver.trajectories(near, np.array([[0.4]] * 3), np.zeros((3, 0)), np.array([[0.5]] * 3))[
        :, 1
    ] == pytest.approx(0.4 / closest)
    assert len(CALLS) == 2


def test_the_misfit_limit_tells_a_trajectory_of_the_simulator_from_one_that_it_cannot_produce() -> None:
    from sim.solvers.misfit import misfit  # noqa: PLC0415

    solver, context, action = grid_solver(TASK), np.array([0.5]), np.array([0.5])
    inside, outside = (np.array([0.0, end]) for end in (0.5 / 1.4, 0.9))
    assert misfit(solver, context, action, inside) <= solver.misfit_limit
    assert misfit(solver, context, action, outside) > 2.0 * solver.misfit_limit


def test_a_policy_takes_the_best_listed_action_that_is_left() -> None:
    listed = np.array([[0.1], [0.5], [0.9]])
    solver = with_listed_actions(grid_solver(TASK), listed)
    known, context = np.array([[[1.0]]]), np.array([0.9])
    left = [0.1, 0.5, 0.9]
    (policy,) = solver.policies(known, np.random.default_rng(0), lambda c, a: float(a[0]) in left)
    assert policy(context).tolist() == [0.9]
    left.remove(0.9)
    assert policy(context).tolist() == [0.5]
    assert policy.predict(context)[0] == pytest.approx(0.6, abs=0.02)
    left.clear()
    with pytest.raises(NotExecutable, match="none of the 3 listed actions can still be executed"):
        policy(context)
    assert policy.actions(np.array([[0.1], [0.9]])).tolist() == [[0.1], [0.9]]


@pytest.mark.parametrize("count", [1, 20])
def test_any_number_of_trials_leaves_both_points_beside_the_truth(count) -> None:
    solver = grid_solver(TASK)
    points = solver.behind.points  # type: ignore[attr-defined]
    below, above = np.sort(points[:, 0])[31:33]
    truth = 0.6 * below + 0.4 * above
    speeds = np.linspace(0.3, 0.9, count)
    ends = [np.array([speed / truth]) for speed in speeds]
    trials = tuple(
        Trial(np.array([0.5]), np.array([speed]), np.concatenate([[0.0], end]), 1.0, end)
        for speed, end in zip(speeds, ends, strict=True)
    )
    reward_table = RewardTable(points, points, np.zeros((len(points), len(points))))
    weights = dict(zip(points[:, 0], OutcomePosterior(Simulators(solver, reward_table), trials).weights, strict=True))
    assert weights[below] == max(weights.values())
    assert weights[above] > 0.5 * weights[below]


def blown(parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: object = None) -> ObjectTrack:
    track = slide(parameters, context, action, nuisance)
    return replace(track, state=track.state + 0.1 * nuisance[0])


def test_a_nuisance_counts_as_the_nearest_of_a_few_draws_which_are_simulated_before_a_session() -> None:
    task = replace(TASK, simulate=blown, nuisance=Space((Dimension("wind", "m/s", 1.0, 2.0),)))
    solver = grid_solver(task)
    grid, two, goal = grid_behind(solver), solver.listed[:2], np.array([[0.5]] * 2)
    assert grid is not None
    requests = grid.requests(two)
    assert len(requests) == 2 * NUISANCES * GRID
    assert requests.nuisance.min() >= 1.0
    with serial_executor() as crew:
        grid.take(two, run_many(task, requests, crew))
    CALLS.clear()
    parameters, wind = np.array([[1.5], [1.7]]), np.array([[1.02], [1.98]])
    paths = solver.trajectories(parameters, two, wind, goal)
    assert not CALLS, "everything was simulated before"
    low, high = paths[:, 0] / 0.1
    assert 1.0 <= low < high <= 2.0
    assert abs(low - 1.02) < 0.25
    again = grid_solver(task)
    restored = grid_behind(again)
    assert restored is not None
    restored.restore(grid.tensors)
    assert np.array_equal(again.trajectories(parameters, two, wind, goal), paths)
    assert not CALLS
    assert not len(replace(grid, task=replace(task, action_noise=frozen_array([0.1]))).requests(two))
