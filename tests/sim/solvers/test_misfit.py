"""A trajectory of which moments are missing weighs parameters by those that were observed."""

from __future__ import annotations

import numpy as np
import pytest

from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.method import ParticleTrials, Trial, require_whole
from sim.adaptation.methods.belief import AdaptSimBelief
from sim.adaptation.posterior import posterior
from sim.errors import MomentsMissing
from sim.solvers.misfit import log_likelihood, misfit, observed_share, squares
from sim.tasks.pushing import TASK


@pytest.fixture(scope="module")
def checkpoint():
    return load_checkpoint(TASK, "default")


def trial(moments: slice) -> Trial:
    """A push of the simulator with the middle parameters, seen at some moments alone."""
    solver = load_checkpoint(TASK, "default").solver
    action = TASK.action.middle
    there = solver.trajectories(
        TASK.parameters.middle[None], action[None], TASK.nuisance.middle[None], TASK.reference_context[None]
    )[0]
    seen = np.full((len(TASK.observation.times_s), 2), np.nan)
    seen[moments] = there.reshape(-1, 2)[moments]
    return Trial(np.asarray(TASK.reference_context), action, seen.ravel(), 0.9, np.array([0.9, 0.0]))


def test_missing_values_are_left_out_of_the_misfit_and_of_the_likelihoods_values(checkpoint):
    whole, late, none = trial(slice(None)), trial(slice(3, None)), trial(slice(0, 0))
    assert [observed_share(t.observation) for t in (whole, late, none)] == [1.0, 0.5, 0.0]
    for seen in (whole, late):
        assert 0.0 <= misfit(checkpoint.solver, seen.context, seen.action, seen.observation) < 1.0
    shifted = whole.observation + 0.1
    hidden = np.where(np.isnan(late.observation), np.nan, shifted)
    path = whole.observation[None]
    off = np.abs(0.1 / np.sqrt(squares(checkpoint.solver, shifted, path)))
    assert squares(checkpoint.solver, hidden, path) > 0.0
    assert off > 0.0
    assert log_likelihood(np.array([[9.0]]), 0.0) == 0.0
    assert log_likelihood(np.array([[9.0]]), 0.5) > log_likelihood(np.array([[9.0]]), 1.0), "fewer values, less said"


@pytest.mark.long
def test_without_any_moment_the_posterior_is_the_prior_and_half_the_moments_say_less(checkpoint):
    belief = AdaptSimBelief(checkpoint.solver, checkpoint.reward_table)
    spread = {}
    for name, moments in (("none", slice(0, 0)), ("late", slice(4, None)), ("whole", slice(None))):
        seen = trial(moments)
        history = ((ParticleTrials(None, (seen, seen)),),)
        known = posterior(belief.likelihood, history)
        assert known is not None
        assert np.isfinite(known.mean).all()
        spread[name] = known.probabilities if hasattr(known, "probabilities") else belief.weights(history)
    prior = belief.weights(())
    assert np.allclose(spread["none"], prior)
    entropy = {name: -(w * np.log(w + 1e-300)).sum() for name, w in spread.items()}
    assert entropy["whole"] < entropy["late"] < entropy["none"]


def test_a_method_that_needs_every_moment_says_so():
    require_whole("sysid-bayes", [trial(slice(None))])
    with pytest.raises(MomentsMissing, match="sysid-bayes needs every moment of a trial, and 1 of the trials miss"):
        require_whole("sysid-bayes", [trial(slice(None)), trial(slice(2, None))])
