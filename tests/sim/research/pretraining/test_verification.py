import dataclasses
import math

import numpy as np
import pytest
from toy_learning import roll, trained
from toy_task import TOY, Unmodelled, simulate

from sim.adaptation.card import Budget, EvaluationReport, Judging
from sim.adaptation.checkpoint import load_checkpoint, save_checkpoint
from sim.research.methods.q_network import QNetwork
from sim.research.methods.q_policy import MemoryName, new_policy, tensors_of
from sim.research.naf.memory import NafMemory
from sim.research.naf.solver import NafSolver, naf_facts, rules_of
from sim.research.pretraining.evaluation import EvaluationSettings
from sim.research.pretraining.verification import CardFigure, verify_figures
from sim.rollouts.executors import serial_executor
from sim.rollouts.run import run_many

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
    assert CardFigure("x", 0.8, found, 0.1, better).holds is holds


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
