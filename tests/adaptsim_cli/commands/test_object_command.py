"""`adaptsim object` writes the file whole and makes the checkpoint that sessions find; a wrong value writes nothing."""

from __future__ import annotations

from pathlib import Path

import pytest
from adaptsim_cli.bench.checkpoints import checkpoint_of

from adaptsim_cli import config
from adaptsim_cli.screen import console

VALUES = ["--task", "pendulum", "--range", "m1=1.5:2.0"]


@pytest.mark.slow
def test_a_session_finds_the_checkpoint_of_an_object(refused, printed):
    told = printed("object", "rod", *VALUES, "--json")
    assert (told["inside"], told["held_out"], told["picture"]) == (True, None, None)
    assert [p["name"] for p in told["parameters"]] == ["m1", "m2", "b1", "b2"]
    assert "m1 = [1.5, 2.0]  # kg" in Path("rod.toml").read_text()
    chosen = config.load({"task": "pendulum", "object": "rod.toml"}).config
    assert str(checkpoint_of(chosen).path) == told["checkpoint"]
    again = printed("object", "rod", *VALUES, "--json")
    assert again["checkpoint"] == told["checkpoint"]
    message = refused(2, "object", "rod", "--task", "pendulum", "--range", "m1=1.6:2.0")
    assert "rod.toml describes another object" in message
    assert "m1 = [1.5, 2.0]" in Path("rod.toml").read_text()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (["--range", "m1=2"], "m1=2: write the two ends of the range as low:high"),
        (["--range", "m1"], "m1: write name=low:high"),
        (["--range", "m3=1:2"], "pendulum has no parameter 'm3'"),
        (["--range", "m1=1:9"], "lies outside the range that the scene of pendulum supports"),
        (["--effect", "wind=a"], "wind=a: write a number"),
        (["--mass", "1"], "pendulum has no mass to set"),
        ([], "there is no terminal to ask at"),
    ],
)
def test_a_wrong_value_writes_nothing(values, message, tmp_path, refused):
    assert message in refused(2, "object", "rod", "--task", "pendulum", *values)
    assert not list(tmp_path.glob("rod*"))


def test_without_values_it_asks(monkeypatch):
    from adaptsim_cli.commands.own_object import _asked  # noqa: PLC0415 - what the command asks
    from sim.tasks import get_task  # noqa: PLC0415

    answers = iter(["0.08:0.16", "", "1e4", "1e4:1e5", "", "", "", "heavy", "0,4"])
    asked = list[str]()

    def answer(question: str) -> str:
        asked.append(question)
        return next(answers)

    monkeypatch.setattr(console, "require_terminal", lambda otherwise: None)
    screen = console.Screen()
    monkeypatch.setattr(screen, "ask", answer)
    own = _asked(screen, "milk", get_task("pushing"))
    assert own.ranges == {"mu": (0.08, 0.16), "mu_p": (1e4, 1e5)}
    assert own.mass_kg == 0.4
    assert asked[0] == "table friction mu, low:high (Enter: 0.05:0.2)?"


def test_only_options_beyond_the_training_are_named_as_the_reason_to_learn():
    from adaptsim_cli.commands.own_object import _beyond  # noqa: PLC0415 - what the command says
    from sim.tasks import get_task  # noqa: PLC0415
    from sim.tasks.own_object import OwnObject  # noqa: PLC0415

    task = get_task("scooping")
    radius = next(d for d in task.nuisance.dimensions if d.name == "radius")
    middle = (radius.low + radius.high) / 2
    wide, narrow = {"radius": (radius.low, 1.2 * radius.high)}, {"radius": (radius.low, middle)}
    assert _beyond(OwnObject("scooping", "tofu", {}, wide), task) == ["--size radius"]
    assert _beyond(OwnObject("scooping", "tofu", {}, narrow, 0.02), task) == ["--mass"]
    assert _beyond(OwnObject("scooping", "tofu", {"mu": (0.3, 0.4)}), task) == []


@pytest.mark.long
def test_the_picture_shows_the_object_small_middle_and_large_on_one_scale():
    import cv2  # noqa: PLC0415
    import numpy as np  # noqa: PLC0415

    from adaptsim_cli.commands.own_object import _png  # noqa: PLC0415 - what the command draws
    from sim.lab.preview import PANEL_PX, low_middle_high  # noqa: PLC0415
    from sim.tasks import get_task  # noqa: PLC0415

    task = get_task("scooping")
    pictures = low_middle_high(task)
    assert len({one.px_per_m for one in pictures}) == 1
    orange = [np.count_nonzero(one.rgb[..., 0] > 1.6 * one.rgb[..., 2].astype(int)) for one in pictures]
    assert 0 < orange[0] < orange[1] < orange[2]
    drawn = cv2.imdecode(np.frombuffer(_png(task), np.uint8), cv2.IMREAD_COLOR)
    assert drawn is not None
    assert drawn.shape == (PANEL_PX + 32, 3 * PANEL_PX, 3)
