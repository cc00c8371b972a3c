"""What to do next, for every sentence that the verdict can say."""

from __future__ import annotations

import inspect

import pytest

from adaptsim_cli.config import same_lab
from adaptsim_cli.session import advice
from adaptsim_cli.session.records import BestRecord, Facts, ResultRecord
from sim.adaptation import verdict

FACTS = Facts(
    name="s", task="scooping", hw="fake", world="ood-1", seed=3, method="adaptsim", particles=2, trials=2,
    created="2026-01-01T00:00:00+00:00", checkpoint="", checkpoint_sha256="", calibration="calibrated",
    calibration_sha256="", versions={}, title="t", object_name="o", parameters=(), context=(), action=(),
)  # fmt: skip


def result(sentence: str, iteration: int = 1) -> ResultRecord:
    best = BestRecord(params={"mu": 0.3}, mean_reward=0.5, trials=4, ci95=(0.2, 0.8))
    return ResultRecord(
        iteration=iteration + 1, trials=(), next_particles=(), best=best, verdict=sentence, timing_s={}, proposal_s=0.0
    )


@pytest.mark.parametrize(
    ("sentence", "iteration", "first"),
    [
        ("Too few trials to judge: 4 so far, at least 6 are needed.", 0, "adaptsim run-iteration --session s"),
        ("Not converged yet: the best expected reward so far is 0.5.", 1, "adaptsim run-iteration --session s"),
        ("Not converged yet: the best expected reward so far is 0.5.", 4, "adaptsim rollout --session s --best"),
        ("Go on: reward 0.6; another iteration is worth 0.05.", 0, "adaptsim run-iteration --session s"),
        ("Stop here: reward 0.9; another iteration is worth 0.00.", 1, "adaptsim rollout --session s --best"),
        (
            "Stop here: no action in the ranges seems to suit this piece (reward 0.0).",
            2,
            "adaptsim calibrate check --task scooping --world ood-1 --seed 3",
        ),
        ("Converged: the parameters have stopped moving.", 2, "adaptsim rollout --session s --best"),
        ("Reward stays low (0.1) although the trajectories look fine.", 3, "adaptsim lab list --task scooping"),
        (
            "Reward stays low (0.1), and the simulator cannot express this piece.",
            3,
            "adaptsim calibrate check --task scooping --world ood-1 --seed 3",
        ),
    ],
)
def test_the_first_step_follows_from_the_verdict(sentence: str, iteration: int, first: str) -> None:
    assert advice.after_iteration(FACTS, result(sentence, iteration))[0][0] == first


def test_every_verdict_is_known() -> None:
    """The openings are those of the sentences in the verdict's source."""
    source = inspect.getsource(verdict)
    for opening in (advice.GO_ON, advice.ENOUGH, advice.HOPELESS, advice.TOO_FEW, advice.NOT_YET, advice.CONVERGED):
        assert f'f"{opening}' in source
    assert advice.STAYS_LOW in source and advice.CANNOT_EXPRESS in source


def test_beside_a_real_arm_the_world_is_the_hardware() -> None:
    assert same_lab("scooping", "fr3", "", 3) == "--task scooping --hw fr3"
    assert same_lab("scooping", "fake", "ood-1") == "--task scooping --world ood-1"
