"""`adaptsim lab`: the truth on stdout, and nothing else there."""

from __future__ import annotations

import json

import cv2
import numpy as np
from typer.testing import CliRunner

from adaptsim_cli.commands.lab import app

runner = CliRunner()


def test_show_prints_the_truth_as_json():
    result = runner.invoke(app, ["show", "--task", "scooping", "--world", "ood-1", "--json"])
    assert result.exit_code == 0
    truth = json.loads(result.stdout)
    assert truth["parameters"] == {"mu": 0.45, "e": 1e4, "g": 0.0, "h": 1.4}
    X_BC = np.array(truth["X_BC"])
    np.testing.assert_allclose(X_BC[:3, :3] @ X_BC[:3, :3].T, np.eye(3), atol=1e-9)


def test_show_prints_a_table_by_default():
    result = runner.invoke(app, ["show", "--task", "scooping", "--world", "ood-1"])
    assert result.exit_code == 0
    assert "0.45" in result.stdout
    assert "X_BC" in result.stdout
    assert "piece height" in result.stdout


def test_show_draws_what_the_camera_sees(tmp_path):
    world = tmp_path / "mine.toml"
    world.write_text('task = "scooping"\n[params]\nmu = 0.3\ne = 5e4\ng = 1\nh = 2.0\n[sensing]\ncamera = "small"\n')
    picture = tmp_path / "seen.png"
    result = runner.invoke(app, ["show", "--task", "scooping", "--world", str(world), "--png", str(picture)])
    assert result.exit_code == 0
    image = cv2.imread(str(picture))
    assert image.shape == (180, 320, 3)
    blue, green, red = image.astype(int).transpose(2, 0, 1)
    assert ((red > 1.5 * green) & (red > 1.5 * blue)).sum() > 3  # the piece


def test_list_explains_the_numbers_of_a_task():
    shown = " ".join(runner.invoke(app, ["list", "--task", "pendulum"]).stdout.split())
    assert "m1 inner mass 1 to 2 kg" in shown
    assert "torque of joint" in shown
