import dataclasses
import functools
import math
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
from toy_learning import SETTINGS, roll, trained
from toy_task import ACTION, PARAMETERS, TOY, Counted, best_action

from sim.adaptation.reward_table import ProspectSettings
from sim.errors import DatasetError
from sim.research.pretraining.evaluation import EvaluationSettings
from sim.research.pretraining.logs import TIMINGS
from sim.research.pretraining.meta_training import MetaSettings
from sim.research.pretraining.pipeline import STAGES, PretrainBudget, pretrain
from sim.research.pretraining.verification.policies import PairSettings, compare_policies, search_policies
from sim.research.pretraining.verification.verify import (
    PARTS,
    VerificationSettings,
    is_finished,
    load_pretrained,
    reliability_bins,
    stage_costs,
    verify,
)
from sim.rollouts import serial_executor
from sim.solvers.emulator.network import Emulator

pytestmark = pytest.mark.long

BUDGET = PretrainBudget(
    rollouts=1024,
    denser=64,
    emulator=dataclasses.replace(SETTINGS, least_steps=400, most_steps=400),
    meta=MetaSettings(episodes=16, parallel=16, library=128),
    prospects=ProspectSettings(candidates=16, truths=64, contexts=2),
    evaluation=EvaluationSettings(targets=2, iterations=2, rollouts=4, oracle=8),
)
FEW = VerificationSettings(PairSettings(environments=8, targets=2, actions=32, rollouts=12), episodes=11)
COUNTED = Counted()


@functools.cache
def finished():
    """The folder of a pretraining of the toy task."""
    folder = tempfile.TemporaryDirectory()
    with serial_executor() as executor:
        pretrain(TOY, Path(folder.name), BUDGET, 0, executor, lambda stage, done, total: None)
    return folder


@pytest.fixture
def folder(tmp_path):
    return Path(shutil.copytree(finished().name, tmp_path / "made"))


@functools.cache
def verified():
    """(verification of that folder, what its progress was, how many rollouts it ran)."""
    seen = []
    with serial_executor() as executor:
        made = load_pretrained(COUNTED.task, Path(finished().name))
        return verify(made, FEW, executor, lambda *call: seen.append(call)), seen, COUNTED.count


def test_a_finished_pretraining_is_verified_and_a_second_time_costs_no_rollout():
    verification, seen, simulated = verified()
    assert simulated == verification.rollouts + 8 * len(PARTS)  # each looks whether its kept rollouts are of this scene
    for part in PARTS:
        last = [call for call in seen if call[0] == part][-1]
        assert last[1] == last[2]
    with serial_executor() as executor:
        again = verify(verification.pretrained, FEW, executor, lambda stage, done, total: None)
    assert COUNTED.count == simulated + 8 * len(PARTS)
    assert np.array_equal(again.pairs.emulated, verification.pairs.emulated)
    assert again.pairs.regret == verification.pairs.regret
    assert again.replays == verification.replays


def test_the_figures_of_a_fair_emulator_are_fair():
    held, pairs = verified()[0].held_out, verified()[0].pairs
    assert held.everywhere.accuracy > held.everywhere.base_rate + 0.05
    assert held.reliability.count.sum() == held.everywhere.rollouts == 77
    assert 0 < held.inside.rollouts < held.everywhere.rollouts
    assert pairs.count == 16
    assert pairs.emulated.mean() > 0.6
    assert pairs.regret.high - pairs.regret.low < 0.3
    assert pairs.regret.mean == pytest.approx((pairs.drake - pairs.emulated).mean())


def test_replayed_episodes_earn_what_the_emulator_paid():
    replays = verified()[0].replays
    assert replays.episodes == 12  # pairs of particles stay together
    every, counted, of_trials = replays.returns
    for found in replays.returns:
        assert found.difference.mean == pytest.approx(found.paid - found.true)
        assert abs(found.difference.mean) < 0.25 * max(found.true, 0.5)
    assert counted.paid < every.paid
    assert of_trials.true < every.true
    for agreement in replays.agreements:
        assert agreement.decisions == 12 * TOY.adaptation.horizon
        assert agreement.emulated.mean > agreement.repeated.mean - 0.1  # the same trials differ less than others
        assert agreement.opposite <= 1.0 - agreement.emulated.mean + 1e-9


def test_what_each_stage_took(folder):
    stages = {cost.stage: cost for cost in stage_costs(load_pretrained(TOY, folder))}
    assert stages[STAGES[0]].simulations == 1088
    assert stages[STAGES[3]].simulations == 0  # the emulator's ensemble answers
    assert stages[STAGES[4]].simulations > 0
    assert all(cost.wall_s >= 0.0 for cost in stages.values())
    (folder / TIMINGS).unlink()
    without = {cost.stage: cost for cost in stage_costs(load_pretrained(TOY, folder))}
    assert without[STAGES[0]].wall_s is None
    assert STAGES[1] not in without  # neither simulations nor time


def test_policies_from_true_rollouts_suit_their_environment():
    environments = PARAMETERS.sample(np.random.default_rng(0), 6)
    policies = search_policies(TOY, environments, roll, 64, np.random.default_rng(1))
    contexts = TOY.context.sample(np.random.default_rng(2), 3)
    miss = [
        np.linalg.norm(ACTION.normalise(p.actions(contexts)) - best_action(e), axis=1)
        for p, e in zip(policies, environments, strict=True)
    ]
    assert np.max(miss) < 0.3
    assert np.mean(miss) < 0.12


class Confused(Emulator):
    """Makes the policy of other parameters than it is asked for."""

    def policies(self, samples, rng, executable=None, settings=None):
        low, high = TOY.parameters.low, TOY.parameters.high
        return super().policies(low + high - samples, rng, executable, settings)


def test_a_confused_emulator_is_found_out():
    settings = PairSettings(environments=10, targets=4, actions=48, rollouts=8)
    good = compare_policies(trained()[0], roll, settings, np.random.default_rng(0))
    bad = compare_policies(Confused(TOY, trained()[0].tensors), roll, settings, np.random.default_rng(0))
    assert abs(good.own_regret.mean) < 0.08
    assert bad.own_regret.low > 0.1
    assert good.ranks.ratio > 0.8


def test_reliability_counts_every_rollout_once():
    rng = np.random.default_rng(0)
    probability = np.append(rng.random(2000) * 0.9, [0.0, 0.899])
    bins = reliability_bins(probability, rng.random(2002) < probability)
    assert bins.count.sum() == 2002
    assert bins.count[9] == 0
    assert math.isnan(bins.observed[9])
    assert np.abs(bins.predicted - bins.observed)[:9].max() < 0.1
    assert ((bins.low <= bins.observed) & (bins.observed <= bins.high))[:9].all()


def test_an_unfinished_folder_and_one_of_other_ranges_are_refused(folder):
    other = dataclasses.replace(TOY, margin=TOY.parameters)
    with pytest.raises(DatasetError, match="wanted toy"):
        load_pretrained(other, folder)
    shutil.rmtree(folder / "checkpoint")
    assert not is_finished(folder)
    with pytest.raises(DatasetError, match="adaptsim pretrain --task toy --out"):
        load_pretrained(TOY, folder)


def test_an_emulator_of_another_dataset_is_refused(folder):
    report = folder / "emulator.toml"
    report.write_text(report.read_text().replace("brier = 0.", "brier = 0.9"))
    made = load_pretrained(TOY, folder)
    with serial_executor() as executor, pytest.raises(DatasetError, match="Brier"):
        verify(made, FEW, executor, lambda stage, done, total: None)
