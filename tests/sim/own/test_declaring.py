"""Each wrong argument of `adaptsim.task` is refused in one sentence with argument, value and remedy."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import adaptsim


def declare(function=None, **changes):
    usual = {
        "parameters": {"mu": (0.1, 0.3)},
        "context": {"goal": (0.5, 1.0, "m")},
        "action": {"push": (0.1, 1.0)},
        "state": {"x": (0.0, 2.0, "m")},
        "duration": 1.0,
        "reward": lambda end, context: 1 - abs(end.x - context.goal),
    }

    def slide(p, action):
        times = np.linspace(0, 1, 5)
        return times, action.push * times / p.mu

    return adaptsim.task(**{**usual, **changes})(function or slide)


WRONG = [
    ({"parameters": {}}, r"parameters = \{\}: name at least one"),
    ({"parameters": {"mu": 0.1}}, r"parameters\['mu'\] = 0.1: it must be \(low, high\)"),
    ({"parameters": {"mu": (0.3, 0.1)}}, r"parameters\['mu'\] = \(0.3, 0.1\): the first number, 0.3, must be smaller"),
    ({"parameters": {"mu": (0.0, 1.0, "", "log")}}, r"a range with scale log begins above 0, not at 0"),
    ({"parameters": {"mu": (0.1, 0.3, "kg", "cubic")}}, r"the scale 'cubic' must be one of log, integer"),
    ({"parameters": {"mu": (0.1, 2.5, "", "integer")}}, r"the ends of an integer range must be whole numbers"),
    ({"parameters": {"a b": (0.1, 0.3)}}, r"the name 'a b' must be a word"),
    ({"parameters": {"ground": ("ice",)}}, r"parameters\['ground'\] = \('ice',\): a category needs two or more"),
    ({"parameters": {"mu": (0.1, float("nan"))}}, r"parameters\['mu'\]"),
    ({"effects": {"mu": 0.0}}, r"effects\['mu'\]: parameters has this name too"),
    (
        {"effects": {"tilt": (0.0, 0.1, 0.2)}},
        r"effects\['tilt'\] = \(0.0, 0.1, 0.2\): it must be \(default, low, high\)",
    ),
    (
        {"margin": {"mux": (0.0, 1.0)}},
        r"margin\['mux'\]: there is no such name, it must be one of mu; did you mean mu\?",
    ),
    (
        {"margin": {"mu": (0.15, 1.0)}},
        r"margin\['mu'\] = \(0.15, 1\): it must contain the parameter's range, 0.1 to 0.3",
    ),
    ({"action": None}, r"action = None: name what a trial can choose"),
    ({"state": {}}, r"state = \{\}: name at least one observed quantity"),
    ({"duration": 0.0}, r"duration = 0.0: it must be a number"),
    ({"duration": "2 s"}, r"duration = '2 s': it must be a number"),
    ({"moments": [0.5, 0.2]}, r"moments = \[0.5, 0.2\]: the times must increase"),
    ({"moments": [0.5, 20.0]}, r"moments = \[0.5, 20.0\]: the times must lie between 0 and the duration of 1 s"),
    ({"moments": 0}, r"moments = 0: it must be a whole number from 1 to 1000"),
    ({"parameters": {"\u00b5": (0.1, 0.3)}}, r"Python reads the letters of this name as others, '\\u03bc' for '\\xb5'"),
    ({"noise": {"x": 100.0}}, r"noise\['x'\] = 100: it is wider than the whole range of this state, 0 to "),
    ({"noise": {"y": 0.1}}, r"noise\['y'\]: there is no such name, it must be one of x"),
    ({"noise": {"x": -0.1}}, r"noise\['x'\] = -0.1: it must be a number of 0 or more"),
    ({"action_error": {"pusch": 0.1}}, r"action_error\['pusch'\]: .* one of push; did you mean push\?"),
    ({"trials": 0}, r"trials = 0: it must be a whole number of 1 or more|trials = 0: it must be a whole number from 1"),
    ({"trial_std": 2.0}, r"trial_std = 2.0: it must be a number from 0 to 1"),
    ({"worlds": {"wd": {"mux": 0.1}}}, r"worlds\['wd'\]\['mux'\]: .* one of mu; did you mean mu\?"),
    ({"worlds": {"wd": {}}}, r"worlds\['wd'\] has no mu: a world states every parameter"),
    ({"worlds": [("wd", 1)]}, r"worlds = .*: it must map names to values"),
    ({"reward": 1.0}, r"reward = 1.0: it must be a function"),
    ({"reward": lambda end: end.y}, r"reward raises AttributeError: end has no 'y': there is x"),
    ({"reward": lambda a, b, c: 0.0}, r"reward takes 3 arguments"),
    ({"reward": lambda end: "much"}, r"reward returns 'much': it must be a number from 0 to 1"),
    ({"reward": lambda end: float("nan")}, r"reward returns nan for the end"),
    ({"measure": lambda times, states: 3}, r"measure returns 3: it must return named numbers"),
    (
        {"state": {"T": (0.0, 2.0)}, "measure": lambda times, states: {"end": states.T}},
        r"state\['T'\]: `states.T` means something else for an array, so measure cannot read it",
    ),
    ({"measure": lambda times, states: {"end": states.z}}, r"the states have no 'z': there is x"),
    ({"outcomes": ["in", "out"]}, r"outcomes = \['in', 'out'\]: it must map words to conditions"),
    ({"outcomes": {"in": None, "out": lambda end: end.x > 1}}, r"outcomes = .*, the last one to None"),
    ({"outcomes": {"in": lambda end, c: end.x > c.goal}}, r"outcomes\['in'\] takes 2 arguments: it must take the end"),
    (
        {"outcomes": {"in": lambda end: end.y > 1}},
        r"outcomes\['in'\] raises AttributeError: end has no 'y': there is x",
    ),
    ({"relocate": lambda o, c: o}, r"relocate: the function takes no context"),
    ({"train": lambda samples, seed: 0}, r"train: slide takes no policy"),
    ({"policies": 8}, r"policies = 8: it belongs to `train`, which is missing"),
]


@pytest.mark.parametrize(("changes", "words"), WRONG)
def test_a_wrong_argument_is_refused_with_its_name_and_value(changes, words):
    with pytest.raises(adaptsim.TaskError, match=words):
        declare(**changes)


def test_a_right_declaration_is_accepted():
    assert declare().name == "slide"


def with_force(p, force): ...
def without_p(action): ...
def with_policy(p, policy): ...
def by_keyword(p, *, action): ...


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (with_force, r"takes \(p, force\): it must take \(p, action\)"),
        (without_p, r"takes \(action\): it must take \(p, action\)"),
        (with_policy, "takes a policy, and the argument `train` is missing"),
        (by_keyword, r"by_keyword takes action only by keyword: leave out the \* before it"),
        (
            lambda p, action: ([0.0], [0.0]),
            r"stands above <function <lambda> at .*: it must stand above a function with",
        ),
    ],
)
def test_a_function_with_other_arguments_is_refused(function, words):
    with pytest.raises(adaptsim.TaskError, match=words):
        declare(function)


def test_wrong_names_of_arguments_are_said_with_the_right_ones():
    with pytest.raises(
        adaptsim.TaskError, match=r"rewards = 1: there is no such argument of adaptsim.task; did you me"
    ):
        declare(rewards=1)
    with pytest.raises(
        adaptsim.TaskError, match=r"adaptsim.task has no state and no reward: a task needs parameters, "
    ):
        adaptsim.task(parameters={}, duration=1.0)
    with pytest.raises(adaptsim.TaskError, match=r"each argument needs its name, as parameters="):
        adaptsim.task({"mu": (0.1, 0.3)})


def test_a_function_may_be_wrapped_by_decorators():
    @functools.lru_cache
    def slide(p, action):
        return [0.0, 1.0], [0.0, p["mu"] * action["push"]]

    task = declare(slide)
    assert task.name == "slide"
    assert task.file.path == __file__
    track = task.simulate(np.array([0.2]), np.array([0.7]), np.array([0.4]), np.zeros(0))
    assert track.state[-1, 0] == pytest.approx(0.08), "values are read as attributes, or by a name in brackets"


def test_the_decorator_stands_above_a_function():
    with pytest.raises(adaptsim.TaskError, match="must stand above a function"):
        adaptsim.task(parameters={}, state={}, duration=1.0, reward=lambda end: 0.0)(3)


def test_a_task_without_worlds_has_one():
    assert declare().worlds["wd"]["params"] == {"mu": pytest.approx(0.1 + 0.4 / 3)}


def test_a_batched_function_simulates_stacks():
    def slide(p, action):
        times = np.linspace(0, 1, 5)
        return times, (action.push / p.mu)[:, None] * times

    task = declare(slide, batched=True)
    one = task.simulate(np.array([0.2]), np.array([0.7]), np.array([0.4]), np.zeros(0))
    assert one.state[-1, 0] == pytest.approx(2.0)
    many = task.simulate_many(np.array([[0.2], [0.1]]), np.zeros((2, 1)), np.array([[0.4], [0.4]]), np.zeros((2, 0)))
    assert [track.state[-1, 0] for track in many] == pytest.approx([2.0, 4.0])
