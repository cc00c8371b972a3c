import pickle
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.adaptation.checkpoint import load_checkpoint, save_checkpoint
from sim.adaptation.reward_table import RewardTableSettings
from sim.errors import CheckpointError, ObjectError
from sim.research.pretraining import for_object
from sim.research.pretraining.budget import PretrainBudget
from sim.research.pretraining.for_object import is_inside, make_ready
from sim.rollouts.executors import serial_executor
from sim.solvers.emulator.training import EmulatorSettings
from sim.tasks import get_task
from sim.tasks.fingerprint import fingerprint
from sim.tasks.own_object import OwnObject, as_toml, load_object, task_of_object, with_ranges

TOFU = """
task = "scooping"
name = "tofu"
[ranges]
mu = [0.30, 0.40]
e = [1e4, 3e4]
g = [1, 2]
h = [2, 2.6]
"""
TINY = PretrainBudget(prospects=RewardTableSettings(candidates=16, truths=64, contexts=2))


def stored(tmp_path, text):
    path = tmp_path / "tofu.toml"
    path.write_text(text)
    return path


def test_the_ranges_become_omega_and_the_margin_goes_along(tmp_path):
    usual = get_task("scooping")
    own = with_ranges(usual, load_object(stored(tmp_path, TOFU)))
    assert own.parameters.low.tolist() == [0.30, 1e4, 1, 2]
    assert own.parameters.high.tolist() == [0.40, 3e4, 2, 2.6]
    assert own.object_name == "tofu"
    assert (own.margin.low <= own.parameters.low).all()
    assert (own.margin.high >= own.parameters.high).all()
    assert all(usual.margin.contains(corner) for corner in (own.margin.low, own.margin.high))
    reach = own.parameters.normalise(own.margin.high)[0], usual.parameters.normalise(usual.margin.high)[0]
    assert reach[0] == pytest.approx(reach[1])  # two thirds of the range beyond its end, for friction
    assert fingerprint(own) != fingerprint(usual)
    assert pickle.loads(pickle.dumps(own)).parameters == own.parameters  # noqa: S301 - as it travels to a worker


def test_the_margin_ends_where_the_scene_was_tried_and_what_is_left_out_keeps_the_tasks_range():
    usual = get_task("scooping")
    high = with_ranges(usual, OwnObject("scooping", "high", {"h": (1.8, 2.9)}))
    assert high.margin.high[3] == usual.margin.high[3]
    assert usual.margin.low[3] < high.margin.low[3] < 1.8
    assert high.parameters.dimensions[:3] == usual.parameters.dimensions[:3]
    assert high.margin.dimensions[:3] == usual.margin.dimensions[:3]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("h = [2, 2.6]", "heigth = [2, 2.6]", "no parameter 'heigth'.* There are: mu, e, g, h"),
        ("mu = ", "m = ", "did you mean mu"),
        ("h = [2, 2.6]", "h = [0.02, 0.026]", r"h \[cm\] = \[0.02, 0.026\] lies outside .* 1.2 to 3 cm: check"),
        ("mu = [0.30", "mu = [-0.30", "lies outside"),
        ("h = [2, 2.6]", "h = [2.6, 2]", r"h = \[2.6, 2\] is not a range"),
        ("g = [1, 2]", "g = [2, 2]", r"g = \[2, 2\] is not a range"),
        ("g = [1, 2]", "g = [0.5, 2]", "whole numbers"),
        ("h = [2, 2.6]", "h = [2]", r"ranges\.h\.1 is missing"),
        ("h = [2, 2.6]", 'h = ["a", 2.6]', r"ranges\.h\.0 = 'a'"),
        ("h = [2, 2.6]", "h = [2, nan]", r"ranges\.h\.1"),
        ('name = "tofu"', 'nam = "tofu"', "unknown key 'nam'"),
        ('name = "tofu"', 'name = "../tofu"', "name = '../tofu'"),
        ('task = "scooping"', 'task = "pushing"', "is for the task pushing, not for scooping"),
        ("[ranges]", "[ranges", "not valid TOML"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, old, new, message):
    path = stored(tmp_path, TOFU.replace(old, new))
    with pytest.raises(ObjectError, match=message):
        with_ranges(get_task("scooping"), load_object(path))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ObjectError, match=r"no object file .*nowhere\.toml"):
        load_object(tmp_path / "nowhere.toml")


def test_a_shipped_object_is_named_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    task = task_of_object("scooping", "blunt-edge")
    assert task.scene is not None and task.scene.edge == (0.0011, 3000.0) and get_task("scooping").scene is None


def test_an_unknown_name_is_refused_with_the_shipped_ones():
    with pytest.raises(ObjectError, match=r"no object blunt: give .*, or a shipped name \(blunt-edge\)"):
        task_of_object("scooping", "blunt")
    with pytest.raises(ObjectError, match=r"a shipped name \(none\)"):
        task_of_object("pendulum", "blunt-edge")


def test_its_checkpoint_holds_the_ranges_and_serves_no_others(tmp_path):
    usual = get_task("pendulum")
    heavy = with_ranges(usual, OwnObject("pendulum", "heavy pendulum", {"m1": (1.6, 2.0), "m2": (2.0, 2.6)}))
    path = save_checkpoint(heavy, tmp_path / "checkpoint", None, {}, {"seed": 0})
    checkpoint = load_checkpoint(heavy, str(path))
    assert checkpoint.card.object == "heavy pendulum"
    assert [(d["low"], d["high"]) for d in checkpoint.card.interface["parameters"][:2]] == [(1.6, 2.0), (2.0, 2.6)]
    assert checkpoint.solver.task is heavy
    target = heavy.parameters.sample(np.random.default_rng(0), 1)[0]
    assert 2.0 <= target[1] <= 2.6
    with pytest.raises(
        CheckpointError, match=r"different parameters, margin of pendulum \(those of heavy pendulum\): pretrain"
    ):
        load_checkpoint(usual, str(path))
    lighter = with_ranges(usual, OwnObject("pendulum", "heavy pendulum", {"m1": (1.5, 2.0), "m2": (2.0, 2.6)}))
    with pytest.raises(CheckpointError, match="different parameters, margin of pendulum: pretrain"):
        load_checkpoint(lighter, str(path))


def test_the_page_says_what_the_code_does(tmp_path):
    page = (Path(__file__).parents[3] / "docs" / "guide" / "own-objects.md").read_text()
    example = re.search(r"```toml\n(.*?)```", page, re.DOTALL).group(1)
    assert with_ranges(get_task("scooping"), load_object(stored(tmp_path, example))).object_name == "tofu"


HEAVY = OwnObject("pushing", "milk", {"mu": (0.08, 0.16)}, {"placed_x": (-0.002, 0.002)}, 0.48, {"com_height_m": 0.045})


def test_mass_and_effects_are_the_scene_of_an_object():
    usual: Any = get_task("pushing")
    own: Any = with_ranges(usual, HEAVY)
    values: Any = [space.denormalise(np.full(len(space), 0.4)) for space in (own.parameters, own.context, own.action)]
    nothing, effects = np.zeros(2), usual.unmodelled(bottle_mass_scale=0.48 / 0.3, com_height_m=0.045)
    track = own.simulate(*values, nothing)
    assert track.state.tolist() == usual.simulate(*values, nothing, effects).state.tolist()
    assert track.state.tolist() != usual.simulate(*values, nothing).state.tolist()
    assert own.require_hardware().rest_pose(values[1], values[0], np.zeros(2), None)[2, 3] < 0.05 - 1.5e-6
    assert own.nuisance.low.tolist() == [-0.002, -0.0035]
    assert fingerprint(own) != fingerprint(with_ranges(usual, replace(HEAVY, mass_kg=0.5)))
    assert fingerprint(usual) == "86d4fc06d6ec1074", "that of the shipped checkpoint"


def test_a_piece_is_weighed_in_the_middle_of_its_ranges():
    own = with_ranges(
        get_task("scooping"), OwnObject("scooping", "cheese", {}, {}, 0.009, {"semi_axis_scale": (1.2, 1.0)})
    )
    parameters, nuisance = (space.middle for space in (own.parameters, own.nuisance))
    effect, usual_kg = own.hardware.weighing
    assert getattr(own.scene, effect) * usual_kg(parameters, nuisance, own.scene) == pytest.approx(0.009)


@pytest.mark.parametrize(
    ("own", "message"),
    [
        (replace(HEAVY, mass_kg=3.0), r"bottle_mass_scale = 10.* lies outside the range .* 0.3 to 3.0: check the unit"),
        (replace(HEAVY, effects={"com_heigth_m": 0.04}), "no effect 'com_heigth_m', did you mean com_height_m"),
        (replace(HEAVY, effects={"contact": 1.0}), "contact takes no 1.0 here"),
        (replace(HEAVY, sizes={"placed_x": (-0.1, 0.1)}), r"placed_x \[m\] = .* lies outside the range"),
        (replace(HEAVY, sizes={"radius": (0.1, 0.2)}), "no size 'radius'"),
        (OwnObject("pendulum", "rod", {}, {}, 1.0), "pendulum has no mass to set"),
    ],
)
def test_a_scene_beyond_what_was_tried_is_refused(own, message):
    with pytest.raises(ObjectError, match=message):
        with_ranges(get_task(own.task), own)


@pytest.mark.parametrize("own", [HEAVY, OwnObject("scooping", "tofu", {"g": (1, 2), "h": (2.0, 2.6)})])
def test_a_written_file_is_read_back(tmp_path, own):
    text = as_toml(get_task(own.task), own)
    assert "friction" in text or "height of the piece" in text
    assert load_object(stored(tmp_path, text)) == own


@pytest.mark.long
def test_a_checkpoint_for_an_object_starts_from_the_shipped_one(tmp_path, monkeypatch):
    monkeypatch.setattr(for_object, "EmulatorSettings", partial(EmulatorSettings, least_steps=20, most_steps=20))
    usual = get_task("pushing")
    own = with_ranges(usual, HEAVY)
    assert not is_inside(own, usual)
    assert is_inside(with_ranges(usual, OwnObject("pushing", "jar", {"mu": (0.08, 0.16)})), usual)
    tiny = RewardTableSettings(candidates=4, truths=8, contexts=1)
    with serial_executor() as executor:
        path, found = make_ready(own, load_checkpoint(usual), tmp_path, 0, executor, lambda *_: None, 64, tiny, 12)
    checkpoint = load_checkpoint(own, str(path))
    assert found.rollouts == 12
    assert found.accuracy > 0.6
    assert checkpoint.emulator.tensors["pw0"].shape == load_checkpoint(usual).emulator.tensors["pw0"].shape
    assert checkpoint.card.facts()["start"] == load_checkpoint(usual).sha256
