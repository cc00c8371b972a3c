"""What the command line says of a world in a foreign physics, and a trial there."""

from __future__ import annotations

import json

from adaptsim_cli import app

WORLD = ["--task", "pushing", "--world", "mujoco-wd"]


def test_it_is_listed_and_shown_with_its_physics(capfd):
    assert app.run(["lab", "list", "--task", "pushing", "--json"]) == 0
    physics = {world["name"]: world["physics"] for world in json.loads(capfd.readouterr().out)["worlds"]}
    assert (physics["wd"], physics["mujoco-wd"]) == ("drake", "mujoco")
    assert app.run(["lab", "show", *WORLD]) == 0
    assert "Its physics is mujoco: the tool is driven directly" in capfd.readouterr().out


def test_nobody_takes_a_picture_there(tmp_path, capfd):
    assert app.run(["lab", "show", *WORLD, "--png", str(tmp_path / "seen.png")]) != 0
    assert "there the tool is driven directly, without arm and camera" in " ".join(capfd.readouterr().err.split())
    assert not (tmp_path / "seen.png").exists()


def test_a_trial_happens_with_the_tool_driven_directly(capfd):
    by_hand = ["--action", "yaw=-0.28", "--action", "speed=0.6"]
    assert app.run(["rollout", *WORLD, "--yes", "--json", *by_hand]) == 0
    trial = json.loads(capfd.readouterr().out)
    assert trial["outcome"] == "upright"
    assert 0.0 <= trial["reward"] <= 1.0
