"""The code of the two tutorials, taken from the pages, against the contracts of every task and of every balance."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import serial_lines
from documents import ROOT, install, install_from, marked, module, require_kept
from notebooks import run_cell
from pydantic import ValidationError
from real_lab import quiet, said

from adaptsim_cli import api
from adaptsim_cli.bench.devices.attended import Instruments
from adaptsim_cli.bench.doctor import checks
from adaptsim_cli.bench.doctor.table import Examined
from adaptsim_cli.bench.facts import RigFacts
from adaptsim_cli.bench.rig_file import devices
from adaptsim_cli.bench.rig_file.description import CameraPart, RigDescription
from adaptsim_cli.bench.rig_file.devices import BalancePart
from adaptsim_cli.bench.rig_file.reading import described, fields_of
from adaptsim_cli.bench.rig_file.template import template
from adaptsim_cli.commands import app
from adaptsim_cli.config import Config, Resolved, places
from adaptsim_cli.errors import UsageError
from hw import plugins
from hw.camera import kinds
from hw.camera.served import loaded
from hw.errors import DeviceUnavailable
from hw.serial import balance
from sim import tasks
from sim.errors import UnknownName
from sim.lab import world
from sim.tasks.task import Task


@pytest.fixture(autouse=True)
def forget_packages(tmp_path, monkeypatch) -> Iterator[None]:
    """What a test installs is not there for the next one, nor are tasks of files that the user registered."""
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    yield
    plugins.offers.cache_clear()


@pytest.fixture
def curling(tmp_path, monkeypatch) -> Iterator[Task]:
    """The task of the tutorial, its package installed for as long as a test runs."""
    install_from("guide/add-a-task.md", tmp_path, tasks.REGISTRY.group)
    monkeypatch.syspath_prepend(tmp_path)
    plugins.offers.cache_clear()
    yield tasks.get_task("curling")
    plugins.offers.cache_clear()
    sys.modules.pop("curling", None)


def test_the_task_of_the_tutorial_keeps_the_contract_of_every_task(curling):
    require_kept(module(ROOT / "tests/contracts/test_task_contract.py"), task=curling)


def test_the_worlds_of_the_tutorial_are_listed_and_differ(curling, capsys):
    assert app.run(["lab", "list", "--task", "curling", "--json"]) == 0
    assert "A slippery table that slopes." in capsys.readouterr().out
    uphill = world.load_world("uphill", curling)
    context, speed, nobody = curling.reference_context, np.array([2.0]), np.zeros(0)
    sloped = curling.simulate(uphill.parameters, context, speed, nobody, uphill.unmodelled)
    level = curling.simulate(uphill.parameters, context, speed, nobody)
    assert sloped.state[-1, 0] < level.state[-1, 0]
    assert curling.score(sloped, sloped.state[-1, :1]) == pytest.approx(1.0)
    assert curling.score(level, sloped.state[-1, :1]) < 1.0


@pytest.mark.long
def test_the_task_of_the_tutorial_is_pretrained_listed_and_run(curling, tmp_path, monkeypatch, capsys):
    with pytest.raises(UnknownName, match="it must be one of pendulum, pushing, scooping, curling"):
        tasks.get_task("darts")
    monkeypatch.chdir(tmp_path)
    fewer = {"pretrain": ["--rollouts", "128", "--denser", "0", "--workers", "1"]}
    (use,) = [code for kind, _, code in marked("guide/add-a-task.md") if kind == "run"]
    for line in use.splitlines():
        program, command, *more = shlex.split(line)
        if program == "adaptsim":
            assert app.run([command, *more, *fewer.get(command, [])]) == 0, line
        else:
            subprocess.run([program, command, *more], check=True)
    assert "curling-uphill" in capsys.readouterr().out
    assert app.run(["checkpoints", "list", "--json"]) == 0
    assert "curling" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import nothing_here", "cannot be imported: ModuleNotFoundError: No module named 'nothing_here'"),
        ("TASK = (", "cannot be imported: SyntaxError: "),
        ("1 / 0", "cannot be imported: ZeroDivisionError: division by zero"),
        ("import sys; sys.exit(3)", "cannot be imported: SystemExit: 3"),
        ("from sim.tasks.task import Task\nTASK = Task(name='darts')", "cannot be imported: TypeError: .*missing"),
        ("NOTHING = 1", "broken has no TASK"),
        ("TASK = 3", "its TASK is a int, not a Task"),
    ],
)
def test_a_package_that_cannot_be_used_is_named_with_version_and_entry_point(code, said, tmp_path, monkeypatch):
    (tmp_path / "broken.py").write_text(code, encoding="utf-8")
    install(tmp_path, "broken", {"darts": "broken"})
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "broken", raising=False)
    plugins.offers.cache_clear()
    where = r"darts of broken 1\.0 \(entry point adaptsim\.tasks: darts = broken\)"
    with pytest.raises(UnknownName, match=rf"task {where}.*{said}"):
        tasks.get_task("darts")
    assert world.tasks_of_world("wd") == ("pendulum", "pushing", "scooping")
    assert re.search(where, checks.CHECKS["plug-ins"].probe(None).detail)


def test_a_name_that_is_taken_is_said(tmp_path, monkeypatch):
    install(tmp_path, "mine", {"pushing": "mine"})
    monkeypatch.syspath_prepend(tmp_path)
    plugins.offers.cache_clear()
    assert "mine 1.0" in checks.CHECKS["plug-ins"].probe(None).detail
    assert "has the name of a built-in one" in checks.CHECKS["plug-ins"].probe(None).detail


def test_the_balance_of_the_tutorial_keeps_the_contract_of_every_balance(tmp_path, monkeypatch):
    found = marked("guide/add-a-device.md")
    (adapter,) = [code for kind, path, code in found if kind == "file" and "balance" in path]
    (said,) = [code for kind, _, code in found if kind == "contract"]
    (tmp_path / "gs_balance.py").write_text(adapter, encoding="utf-8")
    install(tmp_path, "gs-balance", {"gs": "gs_balance"}, balance.BALANCES.group)
    monkeypatch.syspath_prepend(tmp_path)
    plugins.offers.cache_clear()
    assert BalancePart(port="/dev/ttyUSB0", protocol="gs").protocol == "gs"
    assert "balance gs of gs-balance 1.0" in checks.CHECKS["plug-ins"].probe(None).detail
    contract = module(ROOT / "tests/contracts/test_balance_contract.py")
    exec(said, vars(contract))
    require_kept(contract, laden=contract.KINDS["gs"])
    with pytest.raises(ValidationError, match="it must be one of sbi, mt-sics, gs"):
        BalancePart(port="/dev/ttyUSB0", protocol="xyz")


@pytest.mark.long
def test_the_camera_of_the_tutorial_is_found_described_and_recorded_with(tmp_path, monkeypatch):
    """In processes of its own, as every camera: the package is installed where their interpreter finds it."""
    install_from("guide/add-a-device.md", tmp_path, kinds.CAMERAS.group, ("lumen", "pyproject"))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(ROOT)]))
    plugins.offers.cache_clear()
    assert kinds.CAMERAS.names() == ("k4a", "realsense", "lumen")
    report = kinds.probe("lumen", patience_s=60.0)
    assert (report.error, report.serials, report.maker) == (None, ("L-100",), "Lumen One")
    part = CameraPart(kind="lumen")
    with part.camera(infrared=True) as camera:
        assert camera.model().colour.width == 640
        assert camera.snapshot().infrared is not None
        camera.start_recording()
        for _ in range(4):
            camera.snapshot()
        frames = camera.stop_recording()
    assert len(frames) >= 3 and frames[0].depth_mm[0, 0] == 900
    assert "camera lumen of lumen 1.0" in checks.CHECKS["plug-ins"].probe(None).detail
    with pytest.raises(ValidationError, match="it must be one of k4a, realsense, lumen"):
        CameraPart(kind="webcam")


def test_a_camera_adapter_that_does_not_import_is_said(tmp_path, monkeypatch):
    (tmp_path / "torn.py").write_text("import no_such_sdk", encoding="utf-8")
    install(tmp_path, "torn", {"torn": "torn"}, kinds.CAMERAS.group)
    monkeypatch.syspath_prepend(tmp_path)
    plugins.offers.cache_clear()
    with pytest.raises(DeviceUnavailable, match=r"torn of torn 1\.0 .*No module named 'no_such_sdk'"):
        CameraPart(kind="torn").camera()
    with pytest.raises(DeviceUnavailable, match=r"adapter torn:Device cannot be loaded .*no_such_sdk"):
        loaded("torn:Device", lambda: 0.0)


@pytest.fixture
def thermometer(tmp_path, monkeypatch) -> str:
    """The instrument of the tutorial, installed; its name."""
    (code,) = [code for _, path, code in marked("guide/add-a-device.md") if "thermometer" in path]
    (tmp_path / "room_thermometer.py").write_text(code, encoding="utf-8")
    install(tmp_path, "room-thermometer", {"thermometer": "room_thermometer"}, devices.OFFERED_INSTRUMENTS.group)
    monkeypatch.syspath_prepend(tmp_path)
    plugins.offers.cache_clear()
    return "thermometer"


LEAST = {"name": "lab", "arm": {"model": "fr3", "address": "127.0.0.1"}}


def test_the_instrument_of_the_tutorial_is_described_asked_for_read_and_stored(thermometer, tmp_path, monkeypatch):
    assert "device thermometer of room-thermometer 1.0" in checks.CHECKS["plug-ins"].probe(None).detail
    with serial_lines.plugged_in() as line:
        rig = described(LEAST | {"devices": {thermometer: {"port": line.port, "offset_C": -0.5}}}, "rig.toml")
        assert described(tomllib.loads(template(rig, ())), "rig.toml") == rig
        assert "# added to each value, °C, -5 to 5" in template(rig, ())
        lab = Examined(Resolved(Config(hw="fr3"), {}, places()))
        lab.rig = rig
        with serial_lines.answering(line, [b"21.5\r\n"]):
            finding = checks.CHECKS["instruments"].probe(lab)
        assert finding.detail == "thermometer answers, 21.0 °C"
        kind, screen = devices.OFFERED_INSTRUMENTS.get(thermometer), quiet()
        with kind.driver(rig.devices[thermometer]) as driver:
            instruments = Instruments({thermometer: kind}, {thermometer: driver}, screen)
            with serial_lines.answering(line, [b"22.5\r\n", b"?\r\n"]):
                assert RigFacts(instruments=instruments.values()).instruments == {"thermometer.temperature_C": 22.0}
                assert instruments.values() == {}
        assert "no value is stored with this trial: the thermometer answered '?'" in said(screen)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"thermometer": {"port": "/dev/a", "offset_C": 9.0}}, "devices.thermometer.offset_C: it must be less than"),
        ({"thermometer": {}}, "devices.thermometer.port: field required"),
        ({"barometer": {"port": "/dev/a"}}, 'device "barometer" is not known: it must be one of thermometer'),
    ],
)
def test_a_wrong_section_of_an_instrument_is_named(section, message, thermometer):
    with pytest.raises(UsageError, match=message):
        described(LEAST | {"devices": section}, "rig.toml")


def test_an_instrument_shares_no_port(thermometer):
    parts = {"balance": {"port": "/dev/a"}, "devices": {thermometer: {"port": "/dev/a"}}}
    with pytest.raises(UsageError, match="balance and thermometer share the port '/dev/a'"):
        described(LEAST | parts, "rig.toml")


def test_every_device_has_its_section_in_the_rig_file_and_on_the_pages():
    """The doctor's check, the part, the page of the rig file and the reference of files, for each declared kind."""
    rig_page, reference = ((ROOT / "docs" / page).read_text("utf-8") for page in ("guide/rig.md", "reference/files.md"))
    for name, kind in devices.DEVICES.items():
        assert name in checks.CHECKS and name in fields_of(RigDescription)
        assert f"\n[{name}]\n" in rig_page and f"`[{name}]`" in reference
        assert set(kind.choices) <= set(fields_of(kind.part))
    for name in devices.INSTRUMENTS:
        assert f"\n[devices.{name}]\n" in rig_page and f"`[devices.{name}]`" in reference
    for name in fields_of(RigDescription):
        assert re.search(rf"^#?\[*{name}[.\]]|^{name} = ", rig_page, re.MULTILINE), name


@pytest.mark.slow
def test_the_task_of_the_tutorial_asks_and_is_told(curling, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _pretrain("curling", "--rollouts", "256", "--denser", "0")
    shutil.copytree("build/curling/checkpoint", "curling/checkpoints/default")
    session = api.begin("curling", hw="own", seed=0, name="stone")
    session.tell(session.ask(), rejected="the stone hit the edge")
    session.run(4, robot=_released)
    rewards = [iteration.mean_reward for iteration in session.iterations]
    assert rewards[-1] > rewards[0]
    assert [trial.attempt for trial in session.trials[:3]] == [2, 1, 1]
    policy, goals_m = session.best_policy(), np.linspace(0.85, 1.55, 15)
    ends_m = [_slide(float(policy(np.array([goal]))[0]))[1][-1, 0] for goal in goals_m]
    assert 1e3 * np.median(np.abs(np.array(ends_m) - goals_m)) < 60.0


BRAKING_M_S2 = 9.81 * (0.12 * np.cos(0.02) + np.sin(0.02))
"""Of a stone on a table that slopes, which no parameter of the task can express."""


def _slide(speed: float) -> tuple[Any, Any]:
    times_s = np.linspace(0.0, 3.0, 31)
    t_s = np.minimum(times_s, speed / BRAKING_M_S2)
    x_m = speed * t_s - 0.5 * BRAKING_M_S2 * t_s**2
    return times_s, np.column_stack([x_m, np.zeros((31, 2))])


def _released(trial: api.Question) -> dict[str, Any]:
    assert trial.action is not None
    times_s, states = _slide(trial.action["speed"])
    return {"times_s": times_s, "states": states}


@pytest.mark.slow
def test_a_cube_that_is_thrown_by_somebody_else_is_asked_for_and_told(tmp_path, monkeypatch, capsys):
    install(tmp_path, "toss", {"toss": "toss"})
    monkeypatch.syspath_prepend(ROOT / "benchmarks/toss")
    monkeypatch.syspath_prepend(tmp_path)
    plugins.offers.cache_clear()
    monkeypatch.chdir(tmp_path)
    _pretrain("toss", "--budget", "small")
    (source,) = [code for kind, _, code in marked("guide/own-robot.md") if kind == "notebook"]
    names: dict[str, Any] = {}
    moved = run_cell(source, names)
    assert len(names["tosses"].trials) == 4
    assert len(moved) == 2
    plugins.offers.cache_clear()


def _pretrain(task: str, *options: str) -> None:
    assert app.run(["pretrain", "--task", task, "--workers", "1", "--out", f"build/{task}", *options]) == 0
