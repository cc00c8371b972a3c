import dataclasses

import numpy as np
import pytest
import torch
from toy_learning import roll, train_naf
from toy_task import PARAMETERS, TOY, best_action

from sim.adaptation.card import CARD
from sim.adaptation.checkpoint import load_checkpoint, save_checkpoint
from sim.errors import CheckpointError, NotExecutable, UnknownName
from sim.research.methods.q_policy import QPolicy, new_policy, tensors_of
from sim.research.naf.memory import RECORD, NafMemory, features, plan_training
from sim.research.naf.policy import NafNetwork, NafPolicy, naf_training, train_together
from sim.research.naf.solver import NafSolver, in_session, measure_misfit_limit, naf_facts, rules_of
from sim.research.pretraining.episodes import Simulator, SolverActing
from sim.research.pretraining.evaluation import EvaluationSettings, evaluate
from sim.research.pretraining.meta_training import MetaSettings, train_adaptation
from sim.rollouts.run import Requests
from sim.solvers.misfit import misfit
from sim.solvers.solver import policy_for
from sim.tasks import get_task
from sim.tasks.task import ReuseRules
from sim.types import Dimension, Space

RULES = ReuseRules(distance=0.16, first_budget=300, least_budget=50, max_budget=700, discount=0.9)
QUICK = RULES.scaled(0.1)
MEAN = PARAMETERS.denormalise(np.array([0.3, 0.5, 1.0, 0.7]))
NEAR = PARAMETERS.denormalise(np.array([0.4, 0.5, 1.0, 0.7]))
FAR = PARAMETERS.denormalise(np.array([0.9, 0.5, 0.0, 0.1]))


class Counting:
    """True rollouts, counted."""

    def __init__(self):
        self.count, self.calls = 0, 0

    def __call__(self, requests):
        self.count += len(requests)
        self.calls += 1
        return roll(requests)


def solver_with(rules, roll=roll, folder=None, **more):
    return NafSolver(TOY, roll, rules, NafMemory(TOY, folder), **more)


def rng():
    return np.random.default_rng(0)


@pytest.mark.long
def test_policies_are_trained_within_the_budgets_and_reused_by_the_rules():
    counted = Counting()
    solver = solver_with(RULES, counted)
    spent = []
    for mean in (MEAN, FAR, NEAR, MEAN, MEAN):
        before = counted.count
        policy = policy_for(solver, mean[None])
        spent.append(counted.count - before)
    assert spent == [300, 300, 270, 130, 0]  # 0.9 * 300, then what is left of 700, then nothing
    assert [p.donated for p in solver.memory.record] == [True, False, True, True, False]
    action = policy(TOY.reference_context)
    assert np.linalg.norm(TOY.action.normalise(action) - best_action(MEAN)) < 0.15


def test_many_at_once_are_planned_in_their_order_and_share_the_pool():
    counted = Counting()
    solver = solver_with(QUICK, counted)
    policies = solver.policies(np.array([MEAN, FAR, NEAR])[:, None], rng())
    assert counted.count == 30 + 30 + 27
    assert counted.calls == 4  # two rounds of the first two together, then two of the third, which waits for its donor
    again = solver_with(QUICK).policies(np.array([MEAN, FAR, NEAR])[:, None], rng())
    contexts = TOY.context.sample(rng(), 4)
    assert all(np.array_equal(a.actions(contexts), b.actions(contexts)) for a, b in zip(policies, again, strict=True))


def test_training_together_gives_what_training_alone_gives():
    alone = [train_naf(TOY, mean[None], roll, 70, seed) for seed, mean in enumerate((MEAN, FAR))]
    both = train_together([naf_training(TOY, mean[None], 70, seed) for seed, mean in enumerate((MEAN, FAR))], roll)
    contexts = TOY.context.sample(rng(), 4)
    for one, two in zip(alone, both, strict=True):
        assert np.array_equal(one.actions(contexts), two.actions(contexts))
        assert one.value_error == two.value_error < 1.0


def test_a_wide_distribution_does_not_take_over_a_narrow_one():
    counted = Counting()
    solver = solver_with(QUICK, counted)
    wide = PARAMETERS.sample(rng(), 64)
    policy_for(solver, wide.mean(axis=0)[None])
    policy_for(solver, wide)
    assert counted.count == 60
    policy_for(solver, wide)
    assert counted.count == 87  # but its own


def test_expected_rewards_are_those_of_true_rollouts():
    solver = solver_with(RULES)
    contexts = TOY.context.sample(rng(), 8)
    targets = PARAMETERS.sample(rng(), 40)
    actions = np.stack([np.tile(TOY.action.denormalise(best_action(t)), (8, 1)) for t in targets])
    good = solver.expected_rewards(targets, contexts, actions, rng())
    bad = solver.expected_rewards(targets, contexts, np.tile(TOY.action.low, (40, 8, 1)), rng())
    assert good.shape == (40,)
    assert good.min() > 0.9
    error = TOY.action.low + rng().uniform(-1, 1, (40, 2)) * TOY.action_noise
    one_each = solver.trial_rewards(targets, np.tile(contexts[0], (40, 1)), error, np.zeros((40, 1)))
    assert bad.mean() == pytest.approx(one_each.mean(), abs=0.05)
    assert np.corrcoef(bad, one_each)[0, 1] > 0.9
    assert np.array_equal(good, solver.expected_rewards(targets, contexts, actions, rng()))


def test_one_context_is_tried_several_times_and_many_once():
    counted = Counting()
    solver = solver_with(RULES, counted)
    for contexts, wanted in ((1, 8), (8, 8), (20, 20)):
        before = counted.count
        solver.expected_rewards(MEAN[None], TOY.context.sample(rng(), contexts), np.zeros((1, contexts, 2)), rng())
        assert counted.count - before == wanted


def test_its_trajectories_are_the_simulators_and_tell_what_it_cannot_express():
    solver = solver_with(RULES)
    parameters, action, nuisance = PARAMETERS.sample(rng(), 5), TOY.action.sample(rng(), 5), np.zeros((5, 1))
    reference = np.tile(TOY.reference_context, (5, 1))
    wanted = roll(Requests(parameters, reference, action, nuisance)).observation
    paths = solver.trajectories(parameters, action, nuisance, reference)
    assert np.array_equal(paths, TOY.relocate(wanted, reference))
    assert not solver.residual_std.any()
    limit = measure_misfit_limit(solver, rng(), trials=12)
    seen = TOY.observation.with_noise(wanted[0], rng())
    assert misfit(solver, TOY.reference_context, action[0], seen) < 1.5 * limit
    assert misfit(solver, TOY.reference_context, action[0], seen + 0.2) > 1.5 * limit


def test_policies_in_a_folder_survive_the_program(tmp_path):
    contexts = TOY.context.sample(rng(), 4)
    whole = solver_with(QUICK, folder=tmp_path / "whole")
    wanted = [policy_for(whole, m[None], seed=i) for i, m in enumerate((MEAN, NEAR, FAR))]
    parted = tmp_path / "parted"
    policy_for(solver_with(QUICK, folder=parted), MEAN[None], seed=0)
    found = [policy_for(solver_with(QUICK, folder=parted), m[None], seed=i) for i, m in enumerate((MEAN, NEAR, FAR))]
    for one, two in zip(wanted, found, strict=True):
        assert np.array_equal(one.actions(contexts), two.actions(contexts))
        assert isinstance(one, NafPolicy) and isinstance(two, NafPolicy)
        assert one.value_error == two.value_error
    known = solver_with(QUICK, roll=lambda requests: pytest.fail("trained again"), folder=parted)
    again = policy_for(known, NEAR[None], seed=1)
    assert np.array_equal(again.actions(contexts), wanted[1].actions(contexts))
    assert len(known.memory.record) == 3


def test_foreign_and_damaged_policies_are_refused(tmp_path):
    policy_for(solver_with(QUICK, folder=tmp_path), MEAN[None])
    other = Space((*TOY.parameters.dimensions[:3], Dimension("h", "cm", 1.0, 3.0)))
    with pytest.raises(CheckpointError, match="other ranges of toy"):
        NafMemory(dataclasses.replace(TOY, parameters=other), tmp_path)
    path = tmp_path / RECORD
    path.write_text(path.read_text().replace("budget", "bidget"))
    with pytest.raises(CheckpointError, match="damaged"):
        NafMemory(TOY, tmp_path)


def test_only_what_the_arm_can_do_is_done():
    policy = train_naf(TOY, MEAN[None], roll, 300, 0)
    best = policy(TOY.reference_context)
    beyond = dataclasses.replace(policy, executable=lambda context, action: action[0] > best[0] + 0.02)
    forced = beyond(TOY.reference_context)
    assert best[0] + 0.02 < forced[0] < best[0] + 0.1  # the nearest that can be done, or so
    assert beyond.predict(TOY.reference_context)[0] < policy.predict(TOY.reference_context)[0]
    never = dataclasses.replace(policy, executable=lambda context, action: False)
    with pytest.raises(NotExecutable, match="none of the 64 best actions"):
        never(TOY.reference_context)


def test_what_a_policy_says_of_itself_holds():
    off = []
    for seed, mean in enumerate((MEAN, FAR)):
        policy = train_naf(TOY, mean[None], roll, 300, seed)
        contexts = TOY.context.sample(rng(), 32)
        truth = solver_with(RULES).expected_rewards(mean[None], contexts, policy.actions(contexts)[None], rng()).item()
        said = [policy.predict(c) for c in contexts]
        low, high = np.mean([s[1] for s in said]), np.mean([s[2] for s in said])
        assert low - 0.02 <= truth <= high + 0.02
        off.append(high - low)
    assert max(off) < 0.5


@pytest.mark.long
def test_phase_1_runs_on_it():
    solver = solver_with(QUICK)
    simulator = Simulator(solver, SolverActing(solver), roll)
    network, curve, _ = train_adaptation(simulator, MetaSettings(episodes=2, parallel=2), 0)
    assert len(curve[:, 0]) == 1
    assert curve[:, 0].min() > 0.0
    settings = EvaluationSettings(targets=1, particles=1, iterations=1, rollouts=8, oracle=2)
    report = evaluate(solver, {"adaptsim": QPolicy(TOY, network)}, roll, settings, 0)
    assert report.emulator_correlation == pytest.approx(1.0)  # the same rollouts
    assert report.emulator_bias == 0.0


def test_a_checkpoint_restores_it(tmp_path):
    network = new_policy(TOY, "iteration", 5)
    save_checkpoint(
        TOY, tmp_path, None, tensors_of({"iteration": network}), naf_facts(solver_with(QUICK, misfit_limit=1.7))
    )
    restored = load_checkpoint(TOY, str(tmp_path))
    assert isinstance(restored.solver, NafSolver)
    assert restored.solver.rules == QUICK
    assert restored.solver.misfit_limit == 1.7
    assert restored.emulator is None
    with in_session(TOY, restored.naf, 1, tmp_path) as own:
        policy_for(own, MEAN[None])
        assert (own.rules, own.misfit_limit) == (QUICK, 1.7)
    assert (tmp_path / "policies" / RECORD).exists()
    card = tmp_path / CARD
    card.write_text(card.read_text().replace("first_budget", "last_budget"))
    with pytest.raises(CheckpointError, match=r"table naf .* damaged"):
        load_checkpoint(TOY, str(tmp_path))


def test_rules_are_the_papers():
    rules = rules_of(get_task("scooping"))
    assert (rules.distance, rules.first_budget, rules.max_budget, rules.discount) == (0.16, 1200, 4000, 0.9)
    assert rules_of(get_task("pushing"), 0.1).first_budget == 1000
    with pytest.raises(UnknownName, match="pendulum has no solver naf"):
        rules_of(get_task("pendulum"))


def test_the_advantage_is_a_full_positive_definite_quadratic_around_the_mean():
    torch.manual_seed(0)
    network = NafNetwork(2, 3)
    context = torch.rand(6, 2)
    value, mean, factor = network(context)
    precision = factor @ factor.transpose(1, 2)
    assert (torch.linalg.eigvalsh(precision) > 0).all()
    assert precision[:, 0, 1].abs().min() > 0
    assert (factor.triu(1) == 0).all()
    assert torch.allclose(network.q(context, mean), value)
    action = torch.rand(6, 3) * 2 - 1
    miss = (action - mean)[:, :, None]
    expected = value - 0.5 * (miss.transpose(1, 2) @ precision @ miss)[:, 0, 0]
    assert torch.allclose(network.q(context, action), expected, atol=1e-5)
    assert mean.abs().max() < 1


def test_it_finds_the_best_action_from_rollouts_alone():
    policy = train_naf(TOY, MEAN[None], roll, 500, 0)
    action = policy(TOY.reference_context)
    assert TOY.action.contains(action)
    assert np.linalg.norm(TOY.action.normalise(action) - best_action(MEAN)) < 0.12


@pytest.mark.long
def test_training_goes_on_from_a_donor_and_repeats_exactly():
    donor = train_naf(TOY, MEAN[None], roll, 500, 0)
    near = PARAMETERS.step(MEAN, np.array([1, 0, 0, 0]), 0.1)
    one, two = (train_naf(TOY, near[None], roll, 30, 1, donor) for _ in range(2))
    context = TOY.reference_context
    assert np.array_equal(one(context), two(context))
    scratch = train_naf(TOY, near[None], roll, 30, 1)

    def miss(policy):
        return np.linalg.norm(TOY.action.normalise(policy(context)) - best_action(near))

    assert miss(one) < 0.12
    assert miss(one) < miss(scratch)
    assert not np.array_equal(one(context), donor(context))


PAPER = ReuseRules(distance=0.16, first_budget=1200, least_budget=300, max_budget=4000, discount=0.9)


def visit(record, *values):
    return plan_training(record, np.array(values), PAPER)


def test_far_distributions_train_from_scratch_with_the_first_budget():
    first = visit((), 0.1, 0.1)
    second = visit(first.record, 0.1, 0.3)
    assert (first.donor, first.budget) == (second.donor, second.budget) == (None, 1200)


def test_near_ones_go_on_from_the_nearest_with_a_discounted_budget():
    record = visit(visit((), 0.1, 0.1).record, 0.3, 0.1).record
    plan = visit(record, 0.22, 0.1)
    assert plan.donor == 1
    assert plan.budget == 1080
    assert plan.record[-1].budget == 2280
    assert plan.record[-1].distributions == 2


def test_a_donor_gives_only_once():
    record = visit((), 0.1, 0.1).record
    taken = visit(record, 0.1, 0.12)
    assert taken.record[0].donated
    again = visit(taken.record, 0.1, 0.08)
    assert again.donor == 1  # the recipient, not the first donor, though that is nearer
    last = visit(again.record[:2], 0.0, 0.0)
    assert last.donor == 1 or last.donor is None


def test_a_policy_of_full_budget_is_used_as_it_is():
    plan = visit((), 0.1)
    budgets = [plan.budget]
    for _ in range(5):
        plan = visit(plan.record, 0.1)
        budgets.append(plan.budget)
    assert budgets[:4] == [1200, 1080, 972, 748]  # 0.9^3 * 1200 = 875, cut where the total reaches 4000
    assert budgets[4:] == [0, 0]
    assert plan.record[-1].budget == 4000


def test_the_budget_never_falls_below_the_least():
    rules = ReuseRules(distance=0.16, first_budget=1000, least_budget=600, max_budget=10_000, discount=0.5)
    plan = plan_training((), np.zeros(1), rules)
    budgets = []
    for _ in range(3):
        plan = plan_training(plan.record, np.zeros(1), rules)
        budgets.append(plan.budget)
    assert budgets == [600, 600, 600]


def test_distributions_differ_by_their_means_and_their_widths():
    narrow, near = features(np.array([[0.5, 0.5]])), features(np.array([[0.5, 0.6]]))
    wide = features(np.array([[0.0, 0.5], [1.0, 0.5]]))
    assert np.linalg.norm(narrow - near) == pytest.approx(0.1)
    assert np.linalg.norm(narrow - wide) == pytest.approx(0.5)


def test_the_least_budget_of_the_papers_numbers_never_binds():
    for rules in (get_task(name).reuse for name in ("pushing", "scooping")):
        plan = plan_training((), np.zeros(1), rules)
        budgets = [plan.budget]
        while plan.budget:
            plan = plan_training(plan.record, np.zeros(1), rules)
            budgets.append(plan.budget)
        assert sum(budgets) == rules.max_budget
        assert min(budgets[:-2]) > rules.least_budget


def test_contradicting_rules_are_refused():
    with pytest.raises(ValueError, match="M_min <= M <= M_max"):
        dataclasses.replace(PAPER, least_budget=1500)
    with pytest.raises(ValueError, match="alpha = 1"):
        dataclasses.replace(PAPER, discount=1.0)
    assert PAPER.scaled(0.1) == ReuseRules(0.16, first_budget=120, least_budget=30, max_budget=400, discount=0.9)
