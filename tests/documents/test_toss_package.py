"""The task package of the real tosses, installed beside adaptsim as another lab's would be."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from adaptsim_cli.wiring.recorded.folder import read_recorded
from sim import tasks
from sim.tasks.task import Task

ROOT = Path(__file__).parents[2]
PACKAGE, FEW = ROOT / "benchmarks/toss", ROOT / "tests/data/tosses"


@pytest.fixture
def toss(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Task]:
    installed = tmp_path / "toss-1.0.dist-info"
    installed.mkdir()
    (installed / "entry_points.txt").write_text(f"[{tasks.OFFERED}]\ntoss = toss\n")
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: toss\nVersion: 1.0\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.syspath_prepend(PACKAGE)
    tasks._installed.cache_clear()
    yield tasks.get_task("toss")
    tasks._installed.cache_clear()
    for name in [name for name in sys.modules if name == "toss" or name.startswith("toss.")]:
        del sys.modules[name]


def contract() -> ModuleType:
    spec = importlib.util.spec_from_file_location("contract_of_toss", ROOT / "tests/contracts/test_task_contract.py")
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = made
    spec.loader.exec_module(made)
    return made


@pytest.mark.long
def test_it_keeps_the_contract_of_every_task(toss: Task) -> None:
    tests = [
        f
        for name, f in vars(contract()).items()
        if name.startswith("test_") and list(inspect.signature(f).parameters) == ["task"]
    ]
    assert len(tests) >= 5
    for test in tests:
        test(toss)


def test_a_cube_earns_at_its_goal_only_with_the_wanted_face_on_top(toss: Task) -> None:
    trials = read_recorded(toss, FEW)
    assert len(trials) == 12
    for track in trials.tracks:
        x, y, z, *up = track.state[-1]
        axis = int(np.abs(up).argmax())
        face = 2 * axis + (up[axis] < 0.0)
        assert np.abs(up).max() > 0.99 and z == pytest.approx(0.052, abs=0.003)
        assert toss.score(track, np.array([x, y, face])) == pytest.approx(1.0)
        assert toss.score(track, np.array([x + 0.05, y, face])) == pytest.approx(0.5)
        assert toss.score(track, np.array([x, y, (face + 1) % 6])) == 0.0
        anywhere = toss.score(track, np.asarray(toss.reference_context))
        assert anywhere == pytest.approx(max(0.0, 1.0 - np.hypot(x, y) / 0.1))


def test_a_cube_that_starts_at_rest_stays_and_a_slippery_one_slides_farther(toss: Task) -> None:
    nowhere, still = np.asarray(toss.reference_context), np.array([0.0, 0.0, 0.3, 0.1, 0.2, 0.0524, *np.zeros(6)])
    track = toss.simulate(np.array([0.2, 1e6, 4.0]), nowhere, still, np.zeros(0))
    assert track.state[-1, :2] == pytest.approx([0.1, 0.2], abs=2e-3)
    slid = still.copy()
    slid[9] = 0.8
    ends = [toss.simulate(np.array([mu, 1e6, 4.0]), nowhere, slid, np.zeros(0)).state[-1, 0] for mu in (0.1, 0.3)]
    expected = [0.1 + 0.8**2 / (2 * 9.81 * mu) for mu in (0.1, 0.3)]
    assert ends == pytest.approx(expected, rel=0.15)


def write_file(toss: Task, path: Path) -> None:
    """Simulated tosses in the format of the real ones."""
    table = importlib.import_module("toss.physics").Table(0.15, 1e6, 4.0)
    state, start = [], [0]
    for action in read_recorded(toss, FEW).actions:
        flight = table.toss(action.copy())
        rows = np.zeros((len(flight.t_s), 13))
        rows[:, :4], rows[:, 4:7] = flight.rotation[:, [3, 0, 1, 2]], flight.position_m
        rows[0, 7:] = action[6:]
        state.append(rows)
        start.append(start[-1] + len(rows))
    np.savez(path, state=np.concatenate(state), start=start, number=np.arange(len(state)))


@pytest.mark.long
def test_the_experiment_scores_by_tosses_that_no_session_saw_writes_its_page_and_goes_on_where_it_was(
    toss: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    experiment = importlib.import_module("toss.experiment")
    for name, value in {"CONDITIONS": experiment.Conditions(4, 2, judged=16), "GRID": 3, "AUTHORS": 2}.items():
        monkeypatch.setattr(experiment, name, value)
    write_file(toss, tmp_path / "tosses.npz")
    asked = ["toss", str(tmp_path / "tosses.npz"), "--out", str(tmp_path / "out"), "--seeds", "2"]
    monkeypatch.setattr(sys, "argv", [*asked, "--page", str(tmp_path / "docs/results/tosses.md")])
    experiment.main()
    out, told = capsys.readouterr()
    found = json.loads(out.splitlines()[-1])
    assert list(found) == ["udr", *experiment.METHODS, "best_recorded", "permuted", "seeds"]
    assert all(found[name] <= found["best_recorded"] + 1e-9 for name in ("udr", *experiment.METHODS))
    assert "simulated 12 of 12 tosses" in told
    page = (tmp_path / "docs/results/tosses.md").read_text()
    assert f"| `random`, 20 tosses | {found['random']:.3f} (" in page
    assert (tmp_path / "docs/figures/tosses.jpg").stat().st_size > 10_000

    next((tmp_path / "out").rglob("seed-0001-adaptsim.json")).unlink()
    experiment.main()
    again, told = capsys.readouterr()
    assert again == out
    assert "simulated" not in told


def test_a_damaged_file_of_tosses_is_refused(
    toss: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    experiment = importlib.import_module("toss.experiment")
    np.savez(tmp_path / "short.npz", state=np.zeros((9, 13)), start=[0, 12], number=[0])
    np.savez(tmp_path / "narrow.npz", state=np.zeros((9, 12)), start=[0, 9], number=[0])
    (tmp_path / "text.npz").write_text("no file of tosses")
    for name, reason in {"short": "start must give", "narrow": "(T, 13)", "text": "is no file of tosses"}.items():
        monkeypatch.setattr(sys, "argv", ["toss", str(tmp_path / f"{name}.npz"), "--out", str(tmp_path / "out")])
        with pytest.raises(SystemExit):
            experiment.main()
        assert reason in capsys.readouterr().err
