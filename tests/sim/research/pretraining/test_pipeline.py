import dataclasses
import functools
from typing import cast

import numpy as np
import pytest
from toy_learning import SETTINGS, roll, trained
from toy_task import PARAMETERS, TOY, Counted

from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.method import Method
from sim.adaptation.methods import make_method
from sim.adaptation.methods.udr import DRAWS as UDR_POLICIES
from sim.adaptation.reward_table import RewardTableSettings
from sim.errors import CheckpointError, DatasetError, RolloutError
from sim.research.methods.q_network import QNetwork
from sim.research.methods.q_policy import QPolicy, networks_of, new_policy
from sim.research.methods.search import RandomSearch
from sim.research.pretraining import pipeline
from sim.research.pretraining.budget import COMPARED, EVERYTHING, MEMORIES, OptionalStages, PretrainBudget
from sim.research.pretraining.dataset_share import STAGES
from sim.research.pretraining.episodes import (
    EmulatedRolls,
    Library,
    Simulator,
    SolverActing,
    fill_library,
    sparse,
    visit,
)
from sim.research.pretraining.evaluation import EvaluationSettings, evaluate
from sim.research.pretraining.logs import TIMINGS, StageTimer, curve_file, wall_times_s
from sim.research.pretraining.meta_training import (
    MetaSettings,
    explore,
    learning_gate,
    sample_targets,
    train_adaptation,
)
from sim.research.pretraining.pipeline import WORTH, pretrain
from sim.rollouts.executors import serial_executor
from sim.tasks import get_task
from sim.tasks.task import SolverSettings

TINY = PretrainBudget(
    rollouts=256,
    denser=44,
    emulator=dataclasses.replace(SETTINGS, hidden=32, least_steps=150, most_steps=150),
    meta=MetaSettings(episodes=8, parallel=8, library=64),
    prospects=RewardTableSettings(candidates=16, truths=64, contexts=2),
    evaluation=EvaluationSettings(targets=2, iterations=2, rollouts=4, oracle=8),
)


def run(folder, task=TOY, budget=TINY, seed=0, wanted=EVERYTHING):
    seen = []
    with serial_executor() as executor:
        path = pretrain(
            task,
            folder,
            budget,
            seed,
            executor,
            lambda stage, done, total: seen.append((stage, done, total)),
            stages=wanted,
        )
    return path, seen


@functools.cache
def library() -> Library:
    return fill_library(trained()[0], 0, 256)


def simulator(acting=None, seed=0) -> Simulator:
    """The emulator's, as in a training."""
    emulator = trained()[0]
    return Simulator(emulator, acting or library(), EmulatedRolls(emulator, np.random.default_rng(seed)))


@pytest.mark.long
def test_a_visit_earns_more_at_the_right_parameters():
    solver = trained()[0]
    true = Simulator(solver, SolverActing(solver, SolverSettings(candidates=64, scenarios=4)), roll)
    targets = PARAMETERS.sample(np.random.default_rng(0), 16)
    right = visit(true, targets, targets, np.random.default_rng(1))
    wrong = visit(true, targets[::-1], targets, np.random.default_rng(1))
    assert right.observations.shape == (16, 2 * TOY.observation.size)
    assert right.rewards.mean() > wrong.rewards.mean() + 0.1
    again = visit(true, targets, targets, np.random.default_rng(1))
    assert np.array_equal(again.observations, right.observations)
    assert np.array_equal(again.rewards, right.rewards)


def test_targets_of_the_paper_lie_in_omega_and_wide_ones_beyond():
    rng = np.random.default_rng(0)
    assert all(PARAMETERS.contains(t) for t in sample_targets(TOY, "paper", 200, rng))
    wide = sample_targets(TOY, "wide", 200, rng)
    assert all(TOY.margin.contains(t) for t in wide)
    assert not all(PARAMETERS.contains(t) for t in wide)


def test_sparse_rewards_and_exploration():
    assert sparse(TOY, np.array([0.49, 0.5, 0.9])).tolist() == [0.0, 0.5, 0.9]
    rng = np.random.default_rng(0)
    directions = np.ones((400, 3), dtype=int)
    assert (explore(directions, 0.0, rng) == 1).all()
    mixed = explore(directions, 0.5, rng)
    assert (mixed != 1).any(axis=1).mean() == pytest.approx(0.5 * 26 / 27, abs=0.07)


@pytest.mark.long
def test_a_library_lets_every_distribution_act_like_the_nearest_one():
    shelf, rng = library(), np.random.default_rng(1)
    contexts, actions = shelf(shelf.means[:8], rng)
    for i in range(8):  # the same pairs, in another order
        found = {(*c, *a) for c, a in zip(contexts[i], actions[i], strict=True)}
        assert found == {(*c, *a) for c, a in zip(shelf.contexts[i], shelf.actions[i], strict=True)}
    means = PARAMETERS.sample(rng, 64)
    reused = visit(simulator(), means, means, np.random.default_rng(2)).rewards
    solver = trained()[0]
    anew = visit(simulator(SolverActing(solver)), means, means, np.random.default_rng(2)).rewards
    assert abs(reused.mean() - anew.mean()) < 0.02
    assert np.corrcoef(reused, anew)[0, 1] > 0.5


@pytest.mark.long
def test_training_repeats_exactly_and_depends_on_the_seed():
    settings = MetaSettings(episodes=20, parallel=8)
    one, curve, episodes = train_adaptation(simulator(), settings, 0)
    two, same, _ = train_adaptation(simulator(), settings, 0)
    three, _, _ = train_adaptation(simulator(), settings, 1)
    states = np.random.default_rng(0).random((50, one.inputs))
    assert np.array_equal(one.directions(states), two.directions(states))
    assert np.array_equal(curve, same)
    assert not np.array_equal(one.directions(states), three.directions(states))
    assert len(curve) == 3  # 20 episodes are begun 8 at a time
    assert curve[:, 1].tolist() == pytest.approx([0.863, 0.55, 0.237], abs=1e-3)  # from 1 to 0.1
    horizon = TOY.adaptation.horizon
    assert episodes.directions.shape == (12, 2, horizon, len(PARAMETERS))  # pairs of particles on the same target
    moved = TOY.parameters.step(episodes.means[:, :, 0], episodes.directions[:, :, 0].astype(int), TOY.adaptation.delta)
    assert np.allclose(moved, episodes.means[:, :, 1])


@pytest.mark.long
@pytest.mark.parametrize("memory", MEMORIES)
def test_a_policy_with_each_memory_foresees_what_follows_and_learns_to_adapt(memory):
    network, _, episodes = train_adaptation(simulator(), MetaSettings(episodes=400, parallel=50), 0, memory)
    returns = _returns(episodes)
    for t in (0, 2, 4):  # one moment at a time: the values go on after the end of an episode, the returns do not
        values = network(episodes.state(TOY, memory, t)).max(axis=-1).mean(axis=-1)
        assert np.corrcoef(values, returns[t])[0, 1] > 0.5
    gate = learning_gate(simulator(), network, memory, 9, count=128)
    assert gate.passed
    assert gate.policy > max(gate.stay, gate.drift) + 0.05


def _returns(episodes):
    """(H, E * P) discounted sparse rewards of the rest of each episode, after each visit."""
    rewards, total = sparse(TOY, episodes.rewards), np.zeros(episodes.rewards.shape[:2])
    rows = []
    for t in range(rewards.shape[2] - 1, 0, -1):
        total = rewards[:, :, t] + TOY.adaptation.discount * total
        rows.append(total.reshape(-1))
    return np.stack(rows[::-1])


@pytest.mark.long
def test_the_evaluation_orders_oracle_and_udr():
    emulator, _ = trained()
    methods: dict[str, Method] = {
        "adaptsim": QPolicy(TOY, new_policy(TOY, "iteration", 0)),
        "random": RandomSearch(TOY),
    }
    settings = EvaluationSettings(targets=6, iterations=2, rollouts=16, oracle=32)
    report = evaluate(emulator, methods, roll, settings, 0)
    assert report.oracle > report.udr + 0.1
    assert report.trials == 8
    assert report.pairs == 6 * (2 + 2 * 2)
    assert report.emulator_correlation > 0.8
    assert abs(report.emulator_bias) < 0.1
    for score in report.methods:
        assert len(score.reward) == 2
        assert all(
            low <= share <= high for share, (low, high) in zip(score.gap_closed, score.gap_closed_ci95, strict=True)
        )
        assert report.udr + score.above_udr_ci95[0] <= score.reward[-1] <= report.udr + score.above_udr_ci95[1]


@pytest.mark.long
def test_pretraining_makes_a_checkpoint_that_sessions_use(tmp_path):
    path, seen = run(tmp_path)
    checkpoint = load_checkpoint(TOY, str(path))
    cost, *stages = dict.fromkeys(stage for stage, _, _ in seen)
    assert cost.startswith("a rollout takes")
    assert stages == [*STAGES[:3], WORTH, *STAGES[3:]]
    assert all(0 <= done <= total for _, done, total in seen)
    assert checkpoint.card.emulator is not None and checkpoint.card.emulator.held_out > 0
    assert checkpoint.card.evaluation is not None and checkpoint.card.evaluation.targets == 2
    assert checkpoint.card.facts()["budget"]["meta"]["targets"] == "paper"
    dataset = TINY.rollouts + TINY.denser
    assert dataset < checkpoint.card.simulations <= dataset + TINY.uncached(TOY)
    particles = make_method("adaptsim", TOY, checkpoint).start(2, np.random.default_rng(0))
    assert len(particles) == 2


@pytest.mark.long
def test_policies_and_evaluation_are_made_when_they_are_asked_for(tmp_path):
    path, seen = run(tmp_path, wanted=OptionalStages(policies=False, evaluation=False))
    first = load_checkpoint(TOY, str(path))
    _, *stages = dict.fromkeys(stage for stage, _, _ in seen)
    assert stages == ["dataset", "emulator", "reward table", WORTH, "checkpoint"]
    assert first.card.simulations == TINY.rollouts + TINY.denser
    assert not networks_of(first) and first.card.evaluation is None
    assert len(make_method("adaptsim", TOY, first).start(2, np.random.default_rng(0))) == 2
    with pytest.raises(CheckpointError, match="--methods"):
        make_method("adaptsim-iteration", TOY, first)

    run(tmp_path, wanted=OptionalStages(policies=False))
    judged = load_checkpoint(TOY, str(path))
    assert judged.card.evaluation is not None
    assert {score.name for score in judged.card.evaluation.methods} == {"adaptsim-belief", "random"}

    run(tmp_path, wanted=OptionalStages(evaluation=False))
    taught = load_checkpoint(TOY, str(path))
    assert networks_of(taught).keys() == {"iteration", "history", "state"}
    assert taught.card.evaluation == judged.card.evaluation

    run(tmp_path)
    everything = load_checkpoint(TOY, str(path))
    assert everything.card.evaluation is not None
    assert "adaptsim-iteration" in {score.name for score in everything.card.evaluation.methods}
    assert everything.sha256 == taught.sha256


@pytest.mark.long
def test_a_killed_pretraining_goes_on_to_the_same_end_without_repeating_rollouts(tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "require_sound", lambda task, rng: None)  # its rollouts are as many as time allows
    before, after, again = Counted(most=340), Counted(), Counted()
    with pytest.raises(RolloutError, match="power cut"):
        run(tmp_path / "killed", before.task)
    resumed = load_checkpoint(TOY, str(run(tmp_path / "killed", after.task)[0]))
    whole = load_checkpoint(TOY, str(run(tmp_path / "whole")[0]))
    assert resumed.sha256 == whole.sha256
    assert resumed.card.evaluation == whole.card.evaluation
    probes, judged = 10, TINY.evaluation  # twice three for the cost and two more; a request judges all
    interrupted = judged.rollouts * (UDR_POLICIES + 1 + COMPARED * judged.iterations)
    assert before.count + after.count <= whole.card.simulations + probes + interrupted
    run(tmp_path / "killed", again.task)
    assert again.count <= probes / 2


@pytest.mark.long
def test_a_folder_of_another_plan_is_refused(tmp_path):
    run(tmp_path)
    with pytest.raises(DatasetError, match="a different seed"):
        run(tmp_path, seed=1)
    with pytest.raises(DatasetError, match="a different budget"):
        run(tmp_path, budget=dataclasses.replace(TINY, rollouts=400))


def test_fewer_rollouts_are_simulated_where_their_mirror_images_count():
    pushing = get_task("pushing")
    full, one_sided = PretrainBudget.full(pushing), PretrainBudget.full(dataclasses.replace(pushing, mirror=None))
    sizes = [(budget.rollouts, budget.denser) for budget in (full, one_sided)]
    assert [4 * n for n in sizes[0]] == [3 * n for n in sizes[1]]


class Choosing:
    """Stands for a network: moves by a rule."""

    def __init__(self, rule):
        self.directions = rule


def informed(state):
    """The piece's way back and its drift aside tell of mu and h; that is what this reads off, roughly."""
    unit, seen = state[:, :4], TOY.observation.denormalise(state[:, 4 : 4 + TOY.observation.size])
    moved = seen[:, -1, 0] - seen[:, 0, 0]
    expected = 0.05 + 0.1 * (0.25 + 0.4 * unit[:, 3])
    mu = np.clip(unit[:, 0] + (expected - moved) / 0.2, 0.0, 1.0)
    step = np.zeros_like(unit, dtype=int)
    step[:, 0] = np.where(np.abs(mu - unit[:, 0]) > 0.08, np.sign(mu - unit[:, 0]), 0)
    return step


def drifting(state):
    return np.tile([1, 0, 0, -1], (len(state), 1))


def gate(rule):
    acting = SolverActing(trained()[0], SolverSettings(candidates=64, scenarios=4))
    return learning_gate(simulator(acting), cast("QNetwork", Choosing(rule)), "iteration", 0, count=48)


@pytest.mark.long
def test_the_gate_passes_who_moves_by_what_it_sees_and_stops_who_drifts():
    good, idle = gate(informed), gate(drifting)
    assert good.passed
    assert good.policy > max(good.stay, good.drift) + 0.02
    assert good.above_ci95[0] < good.policy - max(good.stay, good.drift) < good.above_ci95[1]
    assert not idle.passed
    assert idle.policy == idle.drift


def test_time_counts_for_the_stage_that_is_reported_and_goes_on_after_a_kill(tmp_path):
    now, seen = [100.0], []

    def report(watch, stage, after_s, done):
        now[0] += after_s
        watch(stage, done, 4)

    first = StageTimer(tmp_path, lambda *call: seen.append(call), lambda: now[0])
    report(first, "dataset", 3.0, 1)
    assert wall_times_s(tmp_path) == {}  # not written yet
    report(first, "dataset", 4.0, 2)  # 7 s since the start: written; then it is killed
    now[0] += 1000.0
    second = StageTimer(tmp_path, lambda *call: seen.append(call), lambda: now[0])
    report(second, "dataset", 2.0, 4)
    report(second, "emulator", 1.5, 4)
    assert wall_times_s(tmp_path) == {"dataset": 9.0, "emulator": 1.5}
    assert seen == [("dataset", 1, 4), ("dataset", 2, 4), ("dataset", 4, 4), ("emulator", 4, 4)]


def test_a_damaged_file_of_times_is_named(tmp_path):
    (tmp_path / TIMINGS).write_text("seconds = 3")
    with pytest.raises(DatasetError, match=TIMINGS):
        wall_times_s(tmp_path)


def test_a_learning_curve_is_a_whole_csv_file_after_every_round(tmp_path):
    path = tmp_path / "policy-iteration.csv"
    log = curve_file(path, ("reward", "epsilon"))
    log([0.25, 1.0])
    assert path.read_text() == "round,reward,epsilon\n1,0.25,1.0\n"
    log([0.5, 0.1])
    assert path.read_text() == "round,reward,epsilon\n1,0.25,1.0\n2,0.5,0.1\n"
    assert list(tmp_path.iterdir()) == [path]
