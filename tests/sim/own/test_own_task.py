"""A task of one file: its spaces, its rollouts here and in a fresh process, and its worlds."""

from __future__ import annotations

import pickle
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from perception.types import Outcome
from sim.errors import TaskError, WorldError
from sim.lab.rollout import rollout_in, task_in
from sim.lab.world import list_worlds, load_world, tasks_of_world
from sim.rollouts.executors import process_pool
from sim.rollouts.run import Requests, run_many
from sim.rollouts.soundness import examine
from sim.tasks import files_of, get_task, task_names, task_of_file
from sim.tasks.task import Task

FILES = Path(__file__).parents[2] / "data/own_simulator"
NOBODY = np.zeros(0)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    return tmp_path


@pytest.fixture
def settle(home: Path) -> Task:
    return task_of_file(str(FILES / "settle.py"))


@pytest.fixture
def shuffle(home: Path) -> Task:
    pytest.importorskip("mujoco")
    return task_of_file(str(FILES / "shuffle.py"))


def requests(task: Task, n: int = 3) -> Requests:
    rng = np.random.default_rng(0)
    spaces = (task.parameters, task.context, task.action, task.nuisance)
    return Requests(*(space.sample(rng, n) for space in spaces))


def test_the_declaration_becomes_the_spaces_of_a_task(settle):
    assert settle.parameters.names == ("ground", "mass", "delay")
    assert settle.parameters.dimensions[0].words == ("ice", "wood", "felt")
    assert settle.parameters.dimensions[1].scale == "log"
    assert (settle.margin.dimensions[2].low, settle.margin.dimensions[2].high) == (0.0, 0.15)
    assert settle.title == "push a block from its start to a goal"
    assert settle.observation.curves == ("x [m]",)
    assert settle.observation.times_s.tolist() == [0.5, 1.0, 2.0, 3.0]
    assert settle.plausible == {"drift": (0.0, 0.1)}
    assert (settle.adaptation.trials_per_iteration, settle.adaptation.horizon) == (3, 4)
    assert settle.adaptation.trial_std == 0.2
    assert settle.relocate is None, "its context is an argument, so it moves things"
    assert settle.physics == "python"


def test_a_margin_that_is_not_declared_keeps_positive_quantities_positive(shuffle):
    low = dict(zip(shuffle.margin.names, shuffle.margin.low, strict=True))
    assert low["mu"] == pytest.approx(0.03)
    assert low["rail"] == pytest.approx(-73.75)
    assert shuffle.physics == "mujoco"
    assert shuffle.relocate is not None, "only its reward knows the context"


def test_its_name_works_as_any_other_once_the_file_was_named(settle):
    assert get_task("settle") is settle
    assert "settle" in task_names()
    assert tasks_of_world("far") == ("settle",)
    assert files_of("settle", "worlds") == FILES / "worlds/settle"


def test_an_unknown_name_is_refused_with_the_names_of_files(settle):
    with pytest.raises(Exception, match=r'task "settel" is not known.*settle.*did you mean settle\?'):
        get_task("settel")


def test_worlds_of_the_declaration_have_categories_by_their_words_and_effects(settle):
    assert list_worlds(settle) == ("far", "wd")
    world = load_world("far", settle)
    assert world.parameters.tolist() == [0.0, 1.0, 0.0]
    assert asdict(world.unmodelled) == {"drift": 0.05}


def test_a_world_file_may_name_a_category_and_is_refused_for_another_word(settle, tmp_path):
    file = tmp_path / "mine.toml"
    text = 'task = "settle"\n[params]\nground = "felt"\nmass = 1.0\ndelay = 0.0\n'
    file.write_text(text)
    assert load_world(str(file), settle).parameters[0] == 2.0
    file.write_text(text.replace("felt", "fel"))
    with pytest.raises(WorldError, match=r"ground = 'fel' in \[params\]: it must be one of ice, wood, felt; did you"):
        load_world(str(file), settle)


def test_a_reward_for_single_trials_is_vectorised_and_clipped(settle):
    ends = np.array([[0.5, 0.5], [2.0, 2.6], [-3.0, 0.0]])
    contexts = np.array([[0.0, 0.5]] * 3)
    assert settle.reward_of_success(ends, contexts) == pytest.approx([1.0, 0.0, 0.0])
    assert settle.reward_of_success(np.tile(ends, (2, 1, 1)), contexts).shape == (2, 3)


def test_the_end_of_a_trial_has_the_words_of_the_task(settle):
    track = settle.simulate(np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.5]), np.array([1.0]), np.zeros(1))
    assert settle.outcome_in_words(track) == "on the table"
    over = replace(track, state=track.state + 3.0)
    assert settle.outcome_in_words(over) == "over the edge"


@pytest.mark.long
@pytest.mark.parametrize("name", ["settle", "shuffle"])
def test_a_fresh_process_finds_task_and_world_again(name, request):
    task = request.getfixturevalue(name)
    assert pickle.loads(pickle.dumps(task)) is task  # noqa: S301 - our own
    asked, world = requests(task), load_world(list_worlds(task)[0], task)
    in_world = task_in(world, task)
    with process_pool(1) as pool:
        for one in (task, in_world):
            there = run_many(one, asked, pool)
            for row, values in enumerate(zip(*(getattr(asked, f) for f in vars(asked)), strict=True)):
                assert np.array_equal(there.observation[row], one.observation(one.simulate(*values)))


def test_effects_of_a_world_change_its_rollouts(shuffle):
    world = load_world("ood", shuffle)
    action = shuffle.action.middle
    level = shuffle.simulate(world.parameters, shuffle.reference_context, action, NOBODY)
    tilted = rollout_in(world, shuffle.reference_context, action)
    assert tilted.state[-1, 1] > level.state[-1, 1]


def test_a_rollout_that_diverges_failed_and_says_why(settle):
    simulation = replace(settle.simulate.function, function=lambda p, c, a: ([0.0, 1.0], [0.0, np.nan]))
    track = simulation(*settle_inputs(settle))
    assert track.outcome is Outcome.SOLVER_FAILED
    assert track.flags == ("the state x is not a number at 1 s",)


@pytest.mark.parametrize(
    ("result", "words"),
    [
        (np.zeros(3), r"returns an array of shape \(3,\): it must return two values"),
        (([0.0, 1.0], np.zeros((2, 3))), r"states of shape \(2, 3\) for 2 times: the shape must be \(2, 1\)"),
        (([1.0, 0.0], [0.0, 1.0]), "times that do not increase after 1 s"),
        (([0.0], ["far"]), "states that are not numbers"),
        (([0.0], [1.0j]), "states that are complex numbers: take their real part"),
        (([*range(200_001)], [*range(200_001)]), "returns 200,001 times: at most 200,000 are kept"),
    ],
)
def test_a_function_that_returns_something_else_is_named_with_its_line(settle, result, words):
    simulation = replace(settle.simulate.function, function=lambda p, c, a: result)
    with pytest.raises(TaskError, match=rf"settle.py, line \d+: .*{words}"):
        simulation(*settle_inputs(settle))


def settle_inputs(task: Task) -> tuple[np.ndarray, ...]:
    return task.parameters.middle, task.context.middle, task.action.middle, task.nuisance.middle


TRAINED = """
import os
import adaptsim
import numpy as np

os.chdir("/")


def train(samples, seed):
    assert samples[0].ground in ("ice", "wood"), samples[0].ground
    return np.array([samples[0].grip])


@adaptsim.task(
    parameters={"k": (0.2, 0.7), "ground": ["ice", "wood"]},
    state={"x": (0, 1)},
    duration=1,
    reward=lambda end: 1 - abs(end.x - 0.3),
    train=train,
)
def lift(p, policy):
    return [0, 1], [0, p.k * policy[0]]
"""


def test_a_training_that_fails_names_its_line_and_gets_categories_by_their_words(home, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("lift.py").write_text(TRAINED)
    task = task_of_file("lift.py")
    assert Path.cwd() == tmp_path, "the file's own change of folder does not last"
    line = 1 + TRAINED.splitlines().index("    return np.array([samples[0].grip])")
    words = rf"lift.py, line {line}: `train` of the task lift fails .*ground = (ice|wood): .*no quantity 'grip'"
    with pytest.raises(TaskError, match=words):
        next(finding for finding in examine(task, np.random.default_rng(0)) if "policy" in finding.check)


@pytest.mark.long
def test_a_task_that_trains_its_policies_is_sound(home):
    pytest.importorskip("gymnasium")
    upend = task_of_file(str(FILES / "upend.py"))
    assert upend.physics == "gymnasium"
    assert upend.training.policies == 8
    assert upend.action.names == upend.parameters.names, "a policy is named by what it was trained for"
    findings = {one.check: one for one in examine(upend, np.random.default_rng(0), 2.0)}
    assert findings["a policy can be trained, stored and loaded"].mark == "kept"
    assert {one.mark for one in findings.values()} <= {"kept", "doubtful"}
