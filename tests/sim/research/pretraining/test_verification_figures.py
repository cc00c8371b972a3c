import dataclasses
import math

import numpy as np
import pytest
from toy_learning import roll, trained
from toy_task import TOY, Unmodelled, simulate

from sim.adaptation.checkpoint import Budget, EvaluationReport, Judging, load_checkpoint, save_checkpoint
from sim.research.methods.q_network import QNetwork
from sim.research.methods.q_policy import MemoryName, new_policy, tensors_of
from sim.research.naf.memory import NafMemory
from sim.research.naf.solver import NafSolver, naf_facts, rules_of
from sim.research.pretraining.evaluation import EvaluationSettings
from sim.research.pretraining.verification.figures import Figure, verify_figures
from sim.research.pretraining.verification.statistics import (
    clustered,
    rank_correlation,
    reliability,
    spearman,
    wilson,
)
from sim.rollouts import run_many, serial_executor

EVALUATION = EvaluationReport(
    kind="paper",
    targets=200,
    trials=20,
    rollouts=8,
    udr=0.57,
    oracle=0.9,
    targets_with_gap=100,
    methods=(),
    pairs=800,
    emulator_correlation=1.0,
    emulator_bias=0.0,
)


def checkpoint_of(folder, evaluation=EVALUATION, **emulated):
    emulator, report = trained()
    networks: dict[MemoryName, QNetwork] = {"iteration": new_policy(TOY, "iteration", 5)}
    facts = {"emulator": dataclasses.asdict(report) | emulated}
    facts |= {"evaluation": dataclasses.asdict(evaluation)} if evaluation else {}
    save_checkpoint(TOY, folder, emulator, tensors_of(networks), facts)
    return load_checkpoint(TOY, str(folder))


def judge(checkpoint, roll=roll, rollouts=240):
    told = []
    figures = verify_figures(checkpoint, roll, rollouts, 0, lambda done, total: told.append((done, total)))
    return {f.name: f for f in figures}, told


def test_what_a_card_says_of_its_own_emulator_holds(tmp_path):
    figures, told = judge(checkpoint_of(tmp_path))
    assert [f.name for f in figures.values() if not f.holds] == []
    assert list(figures) == [
        "emulator: accuracy",
        "emulator: brier",
        "emulator: position error median",
        "emulator: end state error median",
        "mean reward of the policy for all ranges",
        "reward that the emulator adds",
    ]
    assert told[-1] == (240, 240)
    assert told == sorted(told)


def test_a_card_that_says_too_much_does_not(tmp_path):
    checkpoint = checkpoint_of(tmp_path, dataclasses.replace(EVALUATION, udr=0.95), position_error_median=1e-4)
    worse = [f.name for f in judge(checkpoint)[0].values() if not f.holds]
    assert worse == ["emulator: position error median", "mean reward of the policy for all ranges"]


def test_another_scene_is_noticed(tmp_path):
    def windy(parameters, context, action, nuisance, unmodelled=None):
        return simulate(parameters, context, action, nuisance, Unmodelled(pitch_bias_rad=0.15, wind_m=0.02))

    there = dataclasses.replace(TOY, simulate=windy)
    with serial_executor() as executor:
        figures, _ = judge(checkpoint_of(tmp_path), lambda requests: run_many(there, requests, executor))
    assert not figures["emulator: accuracy"].holds
    assert not figures["emulator: position error median"].holds
    assert not figures["reward that the emulator adds"].holds


def test_figures_that_the_card_lacks_are_left_out(tmp_path):
    figures, _ = judge(checkpoint_of(tmp_path, None, end_state_error_median=math.nan), rollouts=60)
    assert list(figures) == ["emulator: accuracy", "emulator: brier", "emulator: position error median"]


def test_policies_that_sessions_train_anew_have_no_figures(tmp_path):
    solver = NafSolver(TOY, roll, rules_of(TOY), NafMemory(TOY), 1.0)
    networks: dict[MemoryName, QNetwork] = {"iteration": new_policy(TOY, "iteration", 5)}
    facts = naf_facts(solver) | {"evaluation": dataclasses.asdict(dataclasses.replace(EVALUATION, udr=0.99))}
    save_checkpoint(TOY, tmp_path, None, tensors_of(networks), facts)
    figures, _ = judge(load_checkpoint(TOY, str(tmp_path)))
    assert figures == {}


@pytest.mark.parametrize(
    ("better", "found", "holds"),
    [
        ("more", 0.9, True),
        ("more", 0.71, True),
        ("more", 0.69, False),
        ("less", 0.1, True),
        ("less", 0.91, False),
        ("neither", 0.75, True),
        ("neither", 0.91, False),
        ("neither", 0.69, False),
    ],
)
def test_only_what_is_worse_offends(better, found, holds):
    assert Figure("x", 0.8, found, 0.1, better).holds is holds


def test_settings_of_the_card_are_used(tmp_path):
    assert EvaluationSettings().kind == "paper"
    wide = checkpoint_of(tmp_path)
    beyond = Budget(evaluation=Judging(kind="wide"))
    wide = dataclasses.replace(wide, card=wide.card.model_copy(update={"budget": beyond}))
    seen = []

    def watched(requests):
        seen.append(requests.parameters)
        return roll(requests)

    judge(wide, watched)
    targets = np.concatenate(seen[10:])  # after the draws for the emulator
    assert not all(TOY.parameters.contains(t) for t in targets)
    assert all(TOY.margin.contains(t) for t in targets)


def test_the_interval_of_clusters_covers_the_mean():
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(60):
        estimate = clustered(rng.normal(0.3, 1.0, 30), rng)
        assert estimate.low < estimate.mean < estimate.high
        covered += estimate.low < 0.3 < estimate.high
    assert 51 <= covered <= 60


def test_wilson_agrees_with_published_values_and_says_nothing_without_data():
    low, high = wilson(np.array([0, 5, 10, 0]), np.array([10, 10, 10, 0]))
    assert low[:3] == pytest.approx([0.0, 0.2366, 0.7225], abs=1e-4)
    assert high[:3] == pytest.approx([0.2775, 0.7634, 1.0], abs=1e-4)
    assert math.isnan(low[3])


def test_reliability_is_the_share_of_variance_that_is_not_noise():
    rng = np.random.default_rng(0)
    truth, common = rng.normal(0.0, 0.2, (400, 1)), rng.normal(0.0, 3.0, 8)
    rewards = truth + common + rng.normal(0.0, 0.4, (400, 8))  # what all have in common does not count
    assert reliability(rewards) == pytest.approx(0.04 / (0.04 + 0.16 / 8), abs=0.04)
    assert reliability(common + rng.normal(0.0, 0.4, (400, 8))) < 0.15
    assert reliability(np.full((5, 3), 0.5)) == 0.0
    few = [reliability(noisy(rng, rng.normal(0.0, 0.2, (13, 1)), 10)[:, 0]) for _ in range(400)]
    assert np.mean(few) == pytest.approx(0.04 / (0.04 + 0.16 / 10), abs=0.03)  # no bias for few policies


def test_spearman_sees_order_alone():
    x = np.array([0.1, 0.4, 0.2, 0.9])
    assert spearman(x, np.exp(5 * x)) == pytest.approx(1.0)
    assert spearman(x, -x) == pytest.approx(-1.0)
    assert spearman(x, np.full(4, 0.3)) == 0.0
    assert spearman(np.array([1.0, 2.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0, 4.0])) == pytest.approx(0.9487, abs=1e-4)


def noisy(rng, truth, rollouts, std=0.4):
    return truth[:, :, None] + rng.normal(0.0, std, (*truth.shape, rollouts))


def test_a_perfect_predictor_reaches_the_ceiling_and_a_poor_one_does_not():
    rng = np.random.default_rng(0)
    ratios, poor, inside = [], [], 0
    for _ in range(30):
        truth = rng.normal(0.5, 0.2, (13, 4))
        rewards = noisy(rng, truth, 10)
        found = rank_correlation(truth, rewards, rng)
        ratios.append(found.ratio)
        inside += found.perfect.low <= found.mean <= found.perfect.high
        poor.append(rank_correlation(truth + rng.normal(0.0, 0.3, truth.shape), rewards, rng).ratio)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.05)
    assert inside >= 26
    assert np.mean(poor) < 0.75


def test_rewards_that_do_not_differ_cannot_be_ranked():
    rng = np.random.default_rng(0)
    found = rank_correlation(rng.random((13, 4)), noisy(rng, np.full((13, 4), 0.5), 10), rng)
    assert math.isnan(found.ratio)
    assert found.chance > 0.05
