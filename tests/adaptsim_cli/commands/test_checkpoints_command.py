"""`adaptsim checkpoints verify`, on the pendulum, whose rollouts cost nothing."""

from __future__ import annotations

import json
import shutil
import tomllib
from pathlib import Path

import pytest

from adaptsim_cli import config
from adaptsim_cli.bench.checkpoints import task_of
from adaptsim_cli.commands import app
from sim.adaptation.card import CARD
from sim.adaptation.checkpoint import save_checkpoint
from sim.research.methods.q_policy import new_policy, tensors_of
from sim.storage.files import read_toml, write_toml
from sim.tasks import TASKS, files_of

PENDULUM = ("--task", "pendulum", "--rollouts", "36", "--json")
"""Twelve targets are enough to tell 0.7 from 0.99."""


@pytest.fixture
def copied(place) -> Path:
    """The shipped checkpoint of the pendulum, to be tampered with."""
    folder = place / "mine"
    shutil.copytree(files_of("pendulum", "checkpoints") / "default", folder)
    return folder


def claim(folder: Path, **evaluation: float) -> None:
    """Write into the card that the policies earn this."""
    card = read_toml(folder / CARD)
    card["evaluation"] |= evaluation
    write_toml(folder / CARD, card)


@pytest.mark.long
def test_a_card_that_holds_ends_with_0(copied, capfd):
    assert app.run(["checkpoints", "verify", str(copied), *PENDULUM]) == 0
    out, err = capfd.readouterr()
    assert "12 of 12" in err  # targets
    found = json.loads(out)
    assert found["holds"] is True
    assert {f["name"] for f in found["figures"]} >= {"mean reward of udr"}
    for figure in found["figures"]:
        assert figure["card"] - figure["found"] <= figure["tolerance"] < 0.3
    assert f"{copied} is intact" in err.replace("\n", "")
    assert "\N{CHECK MARK}" in err


@pytest.mark.long
def test_a_card_that_claims_too_much_ends_with_8(copied, capfd):
    claim(copied, udr=0.99)
    assert app.run(["checkpoints", "verify", str(copied), *PENDULUM]) == 8
    out, err = capfd.readouterr()
    found = json.loads(out)
    assert found["holds"] is False
    assert [f["name"] for f in found["figures"] if not f["holds"]] == ["mean reward of udr"]
    assert "\N{BALLOT X}" in err
    assert "says: mean reward of udr" in err


def test_files_alone_can_be_checked(copied, refused, printed):
    claim(copied, udr=0.99)
    assert (
        printed("checkpoints", "verify", str(copied), "--task", "pendulum", "--rollouts", "0", "--json")["figures"]
        == []
    )
    weights = copied / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:-8] + bytes(8))
    assert "damaged or was changed" in refused(
        8, "checkpoints", "verify", str(copied), "--task", "pendulum", "--rollouts", "0"
    )


def test_an_own_object_has_the_checkpoint_that_was_pretrained_for_it(copied, printed):
    own = copied.parent / "heavy.toml"
    own.write_text('task = "pendulum"\nname = "heavy"\n[ranges]\nm1 = [1.5, 2.0]\n')
    task = task_of(config.load({"task": "pendulum", "object": str(own)}).config)
    made = config.places().pretraining / "pendulum-heavy-seed0" / "checkpoint"
    save_checkpoint(task, made, None, tensors_of({"iteration": new_policy(task, "iteration", 0)}), {})
    shutil.copytree(copied, made.parents[1] / "pendulum-seed0" / "checkpoint")
    asked = ["checkpoints", "verify", "--task", "pendulum", "--rollouts", "0", "--json"]
    assert printed(*asked, "--object", str(own))["folder"] == str(made)
    assert printed(*asked)["folder"] == str(files_of("pendulum", "checkpoints") / "default")


def test_a_damaged_card_does_not_hide_the_others(copied, capfd):
    broken = config.places().pretraining / "scooping-small-seed0" / "checkpoint"
    shutil.copytree(copied, broken)
    (broken / CARD).write_text("task = ")
    assert app.run(["checkpoints", "list", "--json"]) == 0
    found = {row["name"]: row for row in json.loads(capfd.readouterr().out)["checkpoints"]}
    assert "not valid TOML" in found["scooping-small-seed0"]["created"]
    assert found["default"]["task"] in TASKS


def test_wrong_flags_and_objects_are_named(copied, refused):
    assert "--quick and --rollouts contradict each other" in refused(
        2, "checkpoints", "verify", "--task", "pendulum", "--quick", "--rollouts", "9"
    )
    own = copied.parent / "heavy.toml"
    own.write_text('task = "pendulum"\nname = "heavy"\n[ranges]\nm1 = [1.5, 2.0]\n')
    asked = ["checkpoints", "verify", str(copied), "--task", "pendulum", "--object", str(own), "--rollouts", "0"]
    assert "different parameters, margin of pendulum" in refused(8, *asked)


def test_the_trials_that_a_session_needs_are_read_from_beside_the_checkpoint(
    capfd: pytest.CaptureFixture[str],
) -> None:
    assert app.run(["checkpoints", "trials", "--task", "scooping"]) == 0
    said = " ".join(capfd.readouterr().out.split())
    kept = tomllib.loads((files_of("scooping", "checkpoints") / "default" / "trials.toml").read_text(encoding="utf-8"))
    half = kept["first_success"]["half"]
    assert f"an iteration has a success {half['most']} trials ({100 * half['share']:.0f} %)" in said
    assert "64 imagined sessions of 20 trials" in said
    assert app.run(["checkpoints", "trials", "--task", "scooping", "--json"]) == 0
    output = json.loads(capfd.readouterr().out)
    assert output["is_kept"] is True
    assert [one["difference"] for one in output["forecast"]["shown"]] == [0.1, 0.2, 0.4]


@pytest.mark.long
def test_a_new_session_says_it_in_a_line_and_a_continued_one_does_not(
    capfd: pytest.CaptureFixture[str],
) -> None:
    run = ["run-iteration", "--task", "pendulum", "--session", "s", "--yes"]
    assert app.run(run) == 0
    said = " ".join(capfd.readouterr().out.split())
    assert "Of 64 imagined sessions 91 % had a success by trial 4 (adaptsim checkpoints trials" in said
    assert "told to stop" not in said
    assert app.run(run) == 0
    assert "imagined sessions" not in capfd.readouterr().out
    assert app.run([*run[:3], "--method", "random", "--session", "r", "--yes"]) == 0
    assert "imagined sessions" not in capfd.readouterr().out
