"""`adaptsim lab`, and a trial in a world of a foreign physics."""

from __future__ import annotations

import json

import cv2
import numpy as np

from adaptsim_cli.commands import app


def test_show_prints_the_truth_as_json(printed):
    truth = printed("lab", "show", "--task", "scooping", "--world", "ood-1", "--json")
    assert truth["parameters"] == {"mu": 0.45, "e": 1e4, "g": 0.0, "h": 1.4}
    X_BC = np.array(truth["X_BC"])
    np.testing.assert_allclose(X_BC[:3, :3] @ X_BC[:3, :3].T, np.eye(3), atol=1e-9)


def test_show_draws_what_the_camera_sees(tmp_path):
    world = tmp_path / "mine.toml"
    world.write_text('task = "scooping"\n[params]\nmu = 0.3\ne = 5e4\ng = 1\nh = 2.0\n[sensing]\ncamera = "small"\n')
    picture = tmp_path / "seen.png"
    assert app.run(["lab", "show", "--task", "scooping", "--world", str(world), "--png", str(picture)]) == 0
    image = cv2.imread(str(picture))
    assert image.shape == (180, 320, 3)
    blue, green, red = image.astype(int).transpose(2, 0, 1)
    assert ((red > 1.5 * green) & (red > 1.5 * blue)).sum() > 3  # the piece


def test_list_explains_the_numbers_of_a_task(capfd):
    assert app.run(["lab", "list", "--task", "pendulum"]) == 0
    shown = " ".join(capfd.readouterr().out.split())
    assert "inner mass m1 1 to 2 kg" in shown
    assert "torque of joint" in shown


WORLD = ["--task", "pushing", "--world", "mujoco-wd"]


def test_it_is_listed_and_shown_with_its_physics(capfd):
    assert app.run(["lab", "list", "--task", "pushing", "--json"]) == 0
    physics = {world["name"]: world["physics"] for world in json.loads(capfd.readouterr().out)["worlds"]}
    assert (physics["wd"], physics["mujoco-wd"]) == ("drake", "mujoco")
    assert app.run(["lab", "show", *WORLD]) == 0
    assert "Its physics is mujoco: trials run without arm or camera" in capfd.readouterr().out


def test_nobody_takes_a_picture_there(tmp_path, capfd):
    assert app.run(["lab", "show", *WORLD, "--png", str(tmp_path / "seen.png")]) != 0
    assert "there trials run without arm and camera" in " ".join(capfd.readouterr().err.split())
    assert not (tmp_path / "seen.png").exists()


def test_a_trial_happens_with_the_tool_driven_directly(printed):
    by_hand = ["--action", "yaw=-0.28", "--action", "speed=0.6"]
    trial = printed("rollout", *WORLD, "--yes", "--json", *by_hand)
    assert trial["outcome"] == "upright"
    assert 0.0 <= trial["reward"] <= 1.0
