"""One trial by itself: chosen by hand or by a policy, stored whole, nothing adapted."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path

import pytest
from toy_rig import TASK, ToyLab, opener

from adaptsim_cli import app, wiring

RUN = ["rollout", "--task", "toy", "--yes"]


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in os.environ if name.startswith("ADAPTSIM_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch) -> ToyLab:
    lab = ToyLab(0)
    monkeypatch.setattr(wiring, "open_parts", opener(lab))
    return lab


def test_the_trial_of_a_policy(lab: ToyLab, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert app.run([*RUN, "--json", "--out", str(tmp_path / "one")]) == 0
    record = json.loads(capfd.readouterr().out)
    assert record["params"] is not None
    assert 0.0 <= record["reward"] <= 1.0
    assert json.loads((tmp_path / "one" / "trial.json").read_text()) == record
    assert (tmp_path / "one" / "recording.mcap").stat().st_size > 0
    assert not (tmp_path / "home" / "data" / "sessions").exists()


def test_an_action_by_hand_is_executed_as_given(lab: ToyLab, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    dimension = TASK.action.dimensions[0]
    name, middle = dimension.name, (dimension.low + dimension.high) / 2
    assert app.run([*RUN, "--json", "--action", f"{name}={middle}"]) == 0
    record = json.loads(capfd.readouterr().out)
    assert record["action"][name] == pytest.approx(middle)
    assert record["params"] is None


@pytest.mark.parametrize("option", ["--action", "--context", "--param"])
def test_a_wrong_value_moves_nothing(
    lab: ToyLab, tmp_path: Path, capfd: pytest.CaptureFixture[str], option: str
) -> None:
    assert app.run([*RUN, option, "nonsense=1"]) == 2
    assert "write name=value" in capfd.readouterr().err
    assert not (tmp_path / "home" / "data" / "rollouts").exists()


def test_what_exists_is_not_overwritten(lab: ToyLab, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "one").mkdir()
    assert app.run([*RUN, "--out", str(tmp_path / "one")]) == 2
    assert "exists already" in capfd.readouterr().err
    assert lab.executions == []


def test_nobody_to_confirm(lab: ToyLab, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert app.run(["rollout", "--task", "toy"]) == 2
    assert "no terminal" in capfd.readouterr().err
