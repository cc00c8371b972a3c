from __future__ import annotations

import numpy as np
import pytest

from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.method import Particle, ParticleTrials, Trial
from sim.adaptation.methods.udr import udr_policies
from sim.adaptation.posterior import (
    RESOLVED,
    Posterior,
    _effective,
    _tempered,
    expected_reward,
    likelihood_of,
    posterior,
    predicted,
)
from sim.errors import CollapsedPosterior
from sim.solvers.solver import policy_for
from sim.tasks import get_task
from sim.types import Dimension, Space

TASK = get_task("pendulum")
LINE = Space((Dimension("a", "m", 0.0, 4.0),))


def line(*weights: float) -> Posterior:
    return Posterior(LINE, np.arange(len(weights), dtype=float)[:, None], np.array(weights))


def test_quantiles_and_mean_follow_the_weights() -> None:
    known = line(0.0, *[0.1] * 5, *[0.05] * 10, 0.0)
    assert known.quantiles((0.0, 0.5, 0.51, 0.75, 1.0))[:, 0].tolist() == [0.0, 5.0, 6.0, 10.0, 15.0]
    assert known.mean == pytest.approx([0.1 * 15 + 0.05 * 105])
    assert known.effective == pytest.approx(1 / (5 * 0.01 + 10 * 0.0025))


def test_too_few_different_samples_give_no_interval() -> None:
    few = line(*[0.125] * 8)
    with pytest.raises(CollapsedPosterior, match=r"collapsed onto one sample: not an interval \(8.0 effective"):
        few.quantiles((0.05, 0.95))
    repeated = Posterior(LINE, np.repeat([[1.0], [2.0]], 50, axis=0), np.full(100, 0.01))
    assert repeated.effective == pytest.approx(2.0), "repetitions of a sample are no knowledge"
    assert repeated.is_collapsed


def test_sharp_trajectories_are_tempered_to_what_the_grid_resolves_and_vague_ones_are_left_alone() -> None:
    groups, grid = np.arange(200), np.linspace(-1.0, 1.0, 200)
    sharp, vague = -1e7 * grid**2, -0.5 * grid**2
    assert _effective(_tempered(sharp, groups), groups) == pytest.approx(RESOLVED, rel=1e-3)
    likely = np.exp(vague) / np.exp(vague).sum()
    assert _tempered(vague, groups) == pytest.approx(likely)


def test_a_draw_takes_nothing_that_is_impossible() -> None:
    drawn = line(0.0, 0.5, 0.0, 0.5).draw(200, np.random.default_rng(0))
    assert set(drawn[:, 0]) == {1.0, 3.0}


@pytest.mark.parametrize("weights", [(0.5, 0.4), (1.5, -0.5)])
def test_weights_that_are_none_are_refused(weights: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="sum to 1"):
        line(*weights)


def test_a_level_outside_of_0_to_1_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\[0, 1\]"):
        line(*[0.05] * 20).quantiles((1.1,))


def test_a_trajectory_tells_which_parameters_predict_it() -> None:
    checkpoint = load_checkpoint(TASK)
    likelihood = likelihood_of(checkpoint)
    truth = TASK.parameters.denormalise(np.full(len(TASK.parameters), 0.8))
    middle = TASK.parameters.middle
    context, nuisance = TASK.reference_context, np.zeros(len(TASK.nuisance))
    action = policy_for(checkpoint.solver, middle[None])(context)
    track = TASK.simulate(truth, context, action, nuisance)
    trial = Trial(context, action, TASK.observation(track), TASK.score(track, context), TASK.end_of(track))
    before = posterior(likelihood, ())
    after = posterior(likelihood, ((ParticleTrials(Particle(middle[None]), (trial,)),),))

    seen = track.at(TASK.observation.times_s)[:, list(TASK.observation.columns)]

    def off(known: Posterior) -> float:
        drawn = known.draw(32, np.random.default_rng(0))
        return float(np.abs(predicted(checkpoint.solver, drawn, context, action) - seen).mean())

    assert before.effective == pytest.approx(len(before.samples))
    assert after.effective > RESOLVED, "points are added where the weight is, instead of tempering"
    low, high = after.quantiles((0.05, 0.95))
    assert ((low <= truth) & (truth <= high)).all()
    assert (after.space.normalise(high) - after.space.normalise(low)).max() < 0.02
    assert off(after) < 0.25 * off(before), "tempered: as near as the grid resolves"

    states = predicted(checkpoint.solver, np.stack([truth, middle]), context, action)
    assert states.shape == (2, *seen.shape)
    assert np.abs(states[0] - seen).max() < 0.05 * np.abs(states[1] - seen).max()

    udr = expected_reward(
        checkpoint, after, udr_policies(checkpoint.solver, np.random.default_rng(0)), np.random.default_rng(0)
    )
    best = [policy_for(checkpoint.solver, after.mean[None])]
    adapted = expected_reward(checkpoint, after, best, np.random.default_rng(0))
    assert 0.0 <= udr.low <= udr.mean <= udr.high <= 1.0
    assert adapted.mean > udr.mean
