"""The task packages of real recordings, installed beside adaptsim as another lab's would be."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from documents import ROOT, install, module, require_kept

from adaptsim_cli.session.recorded.folder import read_recorded
from hw import plugins
from sim import tasks
from sim.lab.world import load_world
from sim.rollouts.draws import cover
from sim.tasks.task import Task

PACKAGES, FEW = ("toss", "swing"), ROOT / "tests/data/tosses"


@pytest.fixture(autouse=True)
def installed(tmp_path, monkeypatch) -> Iterator[None]:
    for name in PACKAGES:
        install(tmp_path, name, {name: name})
        monkeypatch.syspath_prepend(ROOT / "benchmarks" / name)
    monkeypatch.syspath_prepend(tmp_path)
    plugins.offers.cache_clear()
    yield
    plugins.offers.cache_clear()
    for loaded in [one for one in sys.modules if one.partition(".")[0] in PACKAGES]:
        del sys.modules[loaded]


@pytest.fixture
def toss(installed: None) -> Task:
    return tasks.get_task("toss")


@pytest.fixture
def swing(installed: None) -> Task:
    return tasks.get_task("swing")


@pytest.mark.long
@pytest.mark.parametrize("name", PACKAGES)
def test_it_keeps_the_contract_of_every_task(name):
    require_kept(module(ROOT / "tests/contracts/test_task_contract.py"), task=tasks.get_task(name))


def test_a_cube_earns_at_its_goal_only_with_the_wanted_face_on_top(toss):
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


def test_a_cube_that_starts_at_rest_stays_and_a_slippery_one_slides_farther(toss):
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
    rate_hz = importlib.import_module("toss.data").RATE_HZ
    table = importlib.import_module("toss.physics").Table(0.15, 1e6, 4.0)
    state, start = [], [0]
    for action in read_recorded(toss, FEW).actions:
        flight = table.toss(action.copy())
        at_s = np.arange(0.0, 1.2, 1.0 / rate_hz)  # the sample before each time; at the end the cube rests
        held = np.searchsorted(flight.t_s, at_s, side="right") - 1
        rows = np.zeros((len(at_s), 13))
        rows[:, :4], rows[:, 4:7] = flight.rotation[held][:, [3, 0, 1, 2]], flight.position_m[held]
        rows[0, 7:] = action[6:]
        state.append(rows)
        start.append(start[-1] + len(rows))
    np.savez(path, state=np.concatenate(state), start=start, number=np.arange(len(state)))


@pytest.mark.long
def test_the_experiment_scores_by_tosses_that_no_session_saw_writes_its_page_and_goes_on_where_it_was(
    toss, tmp_path, monkeypatch, capsys
):
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

    monkeypatch.setattr(sys, "argv", [*asked[:-1], "1"])
    importlib.import_module("toss.crossed").main()
    means = json.loads(capsys.readouterr().out.splitlines()[-1])["means"]
    kept = json.loads(next((tmp_path / "out").rglob("seed-0000-adaptsim.json")).read_text())
    assert means["adaptsim > adaptsim"] == pytest.approx(kept["adaptsim"], abs=1e-4)
    assert means["adaptsim: points"] > means["adaptsim: points without the grid's error"] >= 1.0


def test_a_damaged_file_of_tosses_is_refused(toss, tmp_path, monkeypatch, capsys):
    experiment = importlib.import_module("toss.experiment")
    np.savez(tmp_path / "short.npz", state=np.zeros((9, 13)), start=[0, 12], number=[0])
    np.savez(tmp_path / "narrow.npz", state=np.zeros((9, 12)), start=[0, 9], number=[0])
    (tmp_path / "text.npz").write_text("no file of tosses")
    for name, reason in {"short": "start must give", "narrow": "(T, 13)", "text": "is not a file of tosses"}.items():
        monkeypatch.setattr(sys, "argv", ["toss", str(tmp_path / f"{name}.npz"), "--out", str(tmp_path / "out")])
        with pytest.raises(SystemExit):
            experiment.main()
        assert reason in capsys.readouterr().err


def test_a_pendulum_keeps_its_energy_without_friction_and_rests_below_its_friction(swing):
    physics = importlib.import_module("swing")
    j1, lever, g1, g2 = 0.06, 0.33, 0.23, 0.16
    free = np.array([j1, lever, g1, g2, 0.0, 0.0, 0.0, 0.0])
    q1, q2, v1, v2 = physics.integrate(free, np.array([0.9, -0.6, 2.0, 1.0]), np.zeros((physics.NODES, 2))).T
    bend, j2 = physics.LENGTH_M * g2 * np.cos(q2), g2 * lever
    kinetic = 0.5 * (j1 + j2 + 2 * bend) * v1**2 + (j2 + bend) * v1 * v2 + 0.5 * j2 * v2**2
    energy = kinetic - physics.GRAVITY_M_S2 * (g1 * np.cos(q1) + g2 * np.cos(q1 + q2))
    assert np.ptp(kinetic) > 0.3
    assert np.ptp(energy) < 1e-6
    stuck = np.array([j1, lever, g1, g2, 0.25, 0.2, 0.0, 0.0])
    below, above = (physics.integrate(stuck, np.zeros(4), np.tile([u, 0.0], (physics.NODES, 1))) for u in (0.15, 1.0))
    assert np.abs(below[:, 0]).max() < 0.02
    assert np.abs(above[:, 0]).max() > 0.2


@pytest.mark.long
def test_twenty_windows_of_a_simulated_pendulum_find_its_parameters_and_predict_the_others(swing, monkeypatch):
    experiment = importlib.import_module("swing.experiment")
    monkeypatch.setattr(experiment, "POINTS", 64)
    monkeypatch.setattr(experiment, "SEEDS", 2)
    truth = cover(swing.parameters, 64, np.random.default_rng(0))[5]
    actions = np.random.default_rng(0).uniform(-0.8, 0.8, (24, len(swing.action)))
    tracks = tuple(swing.simulate(truth, np.zeros(1), action, np.zeros(0)) for action in actions)
    trials = experiment.RecordedTrials(swing, tuple(map(str, range(24))), None, actions, tracks)
    found, mean = experiment.errors(trials)
    assert np.mean(found["posterior"]) < 0.2 * np.mean(found["prior"])
    assert swing.parameters.normalise(mean) == pytest.approx(swing.parameters.normalise(truth), abs=0.1)
    by_hand = experiment.MODELS["by_hand"][:6]
    assert by_hand == pytest.approx(load_world("wd", swing).parameters, rel=2e-3)


def test_a_damaged_run_is_refused(swing, tmp_path):
    experiment = importlib.import_module("swing.experiment")
    t_s = np.arange(0.0, 3.0, 0.01)
    good = {name: np.zeros(len(t_s)) for name in ("pos_meas1", "pos_meas2", "tau_meas1", "tau_meas2")}
    for run, reason in (
        ({"time": t_s, **good}, "holds 2 windows of one second, and more than 20 are needed"),
        ({"time": t_s[::-1], **good}, "times must not decrease"),
        ({"time": t_s, **good, "tau_meas2": np.full(len(t_s), np.nan)}, "must be finite"),
        ({"time": t_s[:-5], **good}, "equally long"),
        (good, "is not a run"),
    ):
        np.savez(tmp_path / "run.npz", **run)
        with pytest.raises(ValueError, match=reason):
            experiment.read_windows(tmp_path)


@pytest.mark.long
def test_public_tosses_become_the_file_of_the_experiment(toss, tmp_path):
    torch, convert = importlib.import_module("torch"), importlib.import_module("toss.convert")
    written = {int(name) for name in read_recorded(toss, FEW).names}
    assert len(set(convert.NUMBERS)) == 285 and written <= set(convert.NUMBERS) <= set(range(550))
    rng = np.random.default_rng(0)
    runs = {number: rng.standard_normal((4 + number, 13)) for number in (2, 5)}
    for run in runs.values():
        run[:, :4] /= np.linalg.norm(run[:, :4], axis=1, keepdims=True)
    for number, run in runs.items():
        torch.save(torch.tensor(run), tmp_path / f"{number}.pt")
    digest = convert.convert(tmp_path, tmp_path / "tosses.npz", (2, 5))
    tosses = importlib.import_module("toss.data").read_tosses(tmp_path / "tosses.npz")
    assert tosses.trials.names == ("2", "5") and [len(one) for one in tosses.rotations] == [6, 9]
    assert tosses.trials.actions[1, 9:] == pytest.approx(runs[5][0, 10:], abs=1e-6)
    assert len(digest) == len(convert.STATE_SHA256) and digest != convert.STATE_SHA256
    with pytest.raises(ValueError, match=r"7\.pt is missing"):
        convert.convert(tmp_path, tmp_path / "other.npz", (7,))


def test_public_runs_of_the_pendulum_become_the_files_of_the_experiment(swing, tmp_path):
    convert = importlib.import_module("swing.convert")
    with pytest.raises(ValueError, match="has no runs"):
        convert.convert(tmp_path, tmp_path / "runs")
    names = "time,pos_meas1,pos_meas2,tau_meas1,tau_meas2"
    for k in range(5):
        run = tmp_path / convert.RUNS / f"20230629/20230629-1433{k}0"
        run.mkdir(parents=True)
        rows = [",".join(f"{value:.18e}" for value in (0.01 * i, k, 0.1, 0.2, 0.3)) for i in range(3)]
        (run / "trajectory.csv").write_text("\n".join([names, *rows]) + "\n")
    first, second = convert.convert(tmp_path, tmp_path / "runs")
    assert first.name == "design_C.1__sys_id__20230629__20230629-143310__trajectory.npz"
    with np.load(second, allow_pickle=False) as file:
        assert list(file["pos_meas1"]) == [3.0, 3.0, 3.0] and file["time"][2] == pytest.approx(0.02)
