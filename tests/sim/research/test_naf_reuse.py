from dataclasses import replace

import numpy as np
import pytest

from sim.research.naf.memory import features, plan_training
from sim.tasks import get_task
from sim.tasks.task import ReuseRules

RULES = ReuseRules(distance=0.16, first_budget=1200, least_budget=300, max_budget=4000, discount=0.9)


def visit(record, *values):
    return plan_training(record, np.array(values), RULES)


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
        replace(RULES, least_budget=1500)
    with pytest.raises(ValueError, match="alpha = 1"):
        replace(RULES, discount=1.0)
    assert RULES.scaled(0.1) == ReuseRules(0.16, first_budget=120, least_budget=30, max_budget=400, discount=0.9)
