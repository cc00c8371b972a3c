"""Wrong tasks are refused by values and by rollouts, in a sentence that names the field or the values."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from documents import ROOT

from hw.types import frozen_array
from perception.types import ObjectTrack, Outcome
from sim.errors import RolloutError, TaskError
from sim.rollouts.sampled_rollouts import Cost
from sim.rollouts.soundness import examine, require_sound
from sim.types import Dimension, Space

PAGE = (ROOT / "docs/guide/add-a-task.md").read_text(encoding="utf-8")
CODE = re.search(r"^<!-- file curling/__init__.py -->\n```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
MODULE: dict[str, Any] = {"__name__": __name__}
exec(CODE[1].replace("from __future__ import annotations\n", ""), MODULE)
TASK, TIMES_S = MODULE["TASK"], MODULE["TIMES_S"]
curl = MODULE["simulate"]


def track(x, t_s=TIMES_S):
    state = np.stack([x, 0 * x, 0 * x], axis=1)
    return ObjectTrack(t_s, state, Outcome.SETTLED, np.full(3, np.nan), np.ones(len(t_s)))


def line(to):
    return lambda p, c, a, n, u=None: track(np.linspace(0.0, to(p, c, a), 7))


def seen(**changes):
    return replace(TASK, observation=replace(TASK.observation, **changes))


def in_ms(one):
    return replace(one, t_s=1000.0 * one.t_s)


def later(one):
    return replace(one, t_s=5.0 + one.t_s)


def reported(**changes):
    return replace(TASK, report=replace(TASK.report, **changes))


class Leaking:
    """The next rollout begins where this one ended."""

    at = 0.0

    def __call__(self, p, c, a, n, u=None):
        self.at = 0.001 * self.at + curl(p, c, a, n).state[-1, 0]
        return track(np.linspace(0.0, self.at, 7))


class Sticky:
    """Friction that a rollout leaves in a shared model, until the next one sets it."""

    before = (0.0, 0.0)

    def __call__(self, p, c, a, n, u=None):
        now, left = (float(p[0]), float(a[0])), self.before[0] if self.before != (p[0], a[0]) else 0.0
        self.before = now
        return track(np.linspace(0.0, a[0] / p[0] * 0.1 + 1e-3 * left, 7))


TWO = Space((Dimension("speed", "m/s", 0.5, 3.5), Dimension("curl", "rad", -1.0, 1.0)))
WRONG = {
    "reward above 1": (
        lambda: replace(TASK, reward_of_success=lambda e, c: 1.5 - np.abs(e[..., 0] - c[..., 0])),
        r"gives the reward 1\.\d+ with mu = .*: rewards are numbers from 0 to 1",
    ),
    "reward above 1 in a corner": (
        lambda: replace(TASK, reward_of_success=lambda e, c: np.where(e[..., 0] > 4.5, 1.5, 0.2 * e[..., 0] / 4.5)),
        "gives the reward 1.5",
    ),
    "reward of another shape": (
        lambda: replace(TASK, reward_of_success=lambda e, c: np.maximum(0, 1 - np.abs(e - c) / 0.3)),
        r"gives the shape \(3, 2, 1\) .* it must give \(3, 2\)",
    ),
    "reward that ignores the trial": (
        lambda: replace(TASK, reward_of_success=lambda e, c: 0 * e[..., 0] + c[..., 0] / 2),
        "ignores the end of a trial",
    ),
    "reward always 0": (lambda: replace(TASK, reward_of_success=lambda e, c: 0 * e[..., 0]), "is 0 for each of"),
    "not finite at an end": (
        lambda: replace(TASK, simulate=line(lambda p, c, a: np.nan if p[0] < 0.07 else 1.0)),
        r"cannot simulate parameters \[0.06\].*not finite",
    ),
    "margin of another name": (
        lambda: replace(TASK, margin=Space((Dimension("mass", "kg", 0.06, 0.4),))),
        "margin has mass: it must have the parameters, mu",
    ),
    "margin too narrow": (
        lambda: replace(TASK, margin=Space((Dimension("mu", "", 0.15, 0.2),))),
        "margin has mu from 0.15 to 0.2: it must contain the parameter's range, 0.1 to 0.3",
    ),
    "action noise": (lambda: replace(TASK, action=TWO), r"action_noise has the shape \(1,\).*speed, curl"),
    "reference": (
        lambda: replace(TASK, reference_context=frozen_array([120.0])),
        r"reference_context has goal \[m\] = 120: it must lie near its range, 0.8 to 1.6",
    ),
    "observation": (lambda: seen(low=frozen_array([2.0])), r"observation.low = \[2.0\] and high = \[2.0\]"),
    "noise": (lambda: seen(noise_std=frozen_array([-0.1])), r"observation.noise_std = \[-0.1\]: it must be 0 or more"),
    "units too wide": (
        lambda: seen(high=frozen_array([2000.0])),
        r"the state x \[m\] runs from 0 to .* its range is 0 to 2000, hundreds of times as wide",
    ),
    "units too narrow": (lambda: seen(high=frozen_array([0.002])), "far too narrow: both must have the same unit"),
    "late moments": (
        lambda: seen(times_s=frozen_array(np.linspace(0.0, 30.0, 7))),
        "the last observed moment of curling is 30 s, and the longest rollout ends at 3 s",
    ),
    "times in another unit": (
        lambda: replace(TASK, simulate=lambda p, c, a, n, u=None: in_ms(curl(p, c, a, n))),
        "the last observed moment of curling is 3 s, and a rollout ends at 3000 s: times are in s",
    ),
    "times that begin late": (
        lambda: replace(TASK, simulate=lambda p, c, a, n, u=None: later(curl(p, c, a, n))),
        "a rollout begins at 5 s: its times must begin at 0, or its moments there",
    ),
    "reward that draws": (
        lambda: replace(TASK, reward_of_success=lambda e, c: 0 * e[..., 0] + np.random.rand()),  # noqa: NPY002 - the fault
        r"the reward of curling is 0\.\d+, and the second time 0\.\d+ for the same end and context",
    ),
    "times": (
        lambda: replace(TASK, simulate=lambda p, c, a, n, u=None: track(np.linspace(0, a[0], 7), TIMES_S[::-1])),
        "the times of a rollout of curling do not increase",
    ),
    "parameters": (lambda: replace(TASK, simulate=line(lambda p, c, a: a[0])), "ignores its parameters"),
    "action": (lambda: replace(TASK, simulate=line(lambda p, c, a: p[0])), "ignores its action"),
    "context": (
        lambda: replace(TASK, simulate=lambda p, c, a, n, u=None: curl(p, c, a * c[0], n, u)),
        r"`relocate` of curling is wrong: at goal = .* leave relocate out \(None\), or correct it",
    ),
    "chance": (
        lambda: replace(TASK, simulate=line(lambda p, c, a: a[0] + np.random.rand())),  # noqa: NPY002 - the fault
        "is not deterministic: .* may use no random numbers but its arguments",
    ),
    "a leak": (lambda: replace(TASK, simulate=Leaking()), "Either something is left in a shared model"),
    "a leak that the next one hides": (
        lambda: replace(TASK, simulate=Sticky()),
        "depends on the rollouts before it: repeated in reverse order, .* left in a shared model: make a new one",
    ),
    "stacks of another physics": (
        lambda: replace(TASK, simulate_many=lambda P, C, A, N: [track(np.linspace(0, 9.9, 7)) for _ in P]),
        "`simulate_many` of curling differs from `simulate`",
    ),
    "columns": (lambda: reported(columns=("x [m]",)), "have 3 columns, and report.columns names 1"),
    "outcomes": (
        lambda: reported(outcomes=(Outcome.ON_TABLE,), successes=(Outcome.ON_TABLE,)),
        "ends settled, and report.outcomes has on_table",
    ),
    "success": (lambda: replace(TASK, succeeded=lambda t: True), "says True for the outcome on_blade"),
    "settings": (
        lambda: replace(TASK, adaptation=replace(TASK.adaptation, threshold=8.0)),
        "adaptation.threshold = 8: it must lie in 0 to 1",
    ),
    "an outcome in words": (
        lambda: replace(
            TASK,
            simulate=lambda p, c, a, n, u=None: replace(curl(p, c, a, n), outcome="done"),
        ),
        "gives the outcome 'done': it must be one of Outcome",
    ),
    "no track": (
        lambda: replace(TASK, simulate=lambda *values: np.zeros((7, 3))),
        "returns ndarray, not an ObjectTrack",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_task_is_refused_with_what_is_right(name):
    make, words = WRONG[name]
    with pytest.raises((RolloutError, TaskError), match=words):
        require_sound(make(), np.random.default_rng(0))


def test_a_context_that_changes_nothing_is_doubtful():
    fixed = replace(TASK, reward_of_success=lambda e, c: np.clip(1.0 - np.abs(e[..., 0] - 1.0) / 5.0, 0.0, 1.0))
    doubts = [one.detail for one in examine(fixed, np.random.default_rng(0), 2.0) if one.mark == "doubtful"]
    assert "goal changes neither the motion nor the reward: is it used?" in doubts


def test_the_task_of_the_tutorial_is_sound_and_its_cost_is_known():
    costs = list[Cost]()
    findings = [*examine(TASK, np.random.default_rng(0), 2.0, costs.append)]
    assert {one.mark for one in findings} <= {"kept", "doubtful"}
    assert costs[0].rollouts > 20
    assert 0.0 < costs[0].median_s <= costs[0].longest_s
