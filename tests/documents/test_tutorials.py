"""The code of the two tutorials, taken from the pages, against the contracts of every task and of every balance."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator

import numpy as np
import pytest
from documents import ROOT, install, module, require_kept
from pydantic import ValidationError

from adaptsim_cli import app
from adaptsim_cli.devices.rig_file.description import BalancePart, CameraPart
from adaptsim_cli.doctor import checks
from hw import plugins
from hw.camera import kinds
from hw.camera.served import loaded
from hw.errors import DeviceUnavailable
from hw.serial import balance
from sim import tasks
from sim.errors import UnknownName
from sim.lab import world
from sim.tasks.task import Task

BLOCK = re.compile(r"^<!-- (\w+) (\S+) -->\n```\w+\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(page: str) -> list[tuple[str, str, str]]:
    """(kind, path, code) of the marked code of a page, in order."""
    return BLOCK.findall((ROOT / "docs/guide" / page).read_text(encoding="utf-8"))


@pytest.fixture(autouse=True)
def forget_packages() -> Iterator[None]:
    """What a test installs is not there for the next one."""
    yield
    plugins.offers.cache_clear()


@pytest.fixture
def curling(tmp_path, monkeypatch) -> Iterator[Task]:
    """The task of the tutorial, its package installed for as long as a test runs."""
    for _, path, code in [block for block in blocks("add-a-task.md") if block[0] == "file"]:
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(code, encoding="utf-8")
    project = tomllib.loads((tmp_path / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    install(tmp_path, project["name"], project["entry-points"][tasks.OFFERED])
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
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    with pytest.raises(UnknownName, match="it must be one of pendulum, pushing, scooping, curling"):
        tasks.get_task("darts")
    monkeypatch.chdir(tmp_path)
    fewer = {"pretrain": ["--rollouts", "128", "--denser", "0", "--workers", "1"]}
    (use,) = [code for kind, _, code in blocks("add-a-task.md") if kind == "run"]
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
        ("TASK = 3", "its TASK is a int; both names must agree"),
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
    found = blocks("add-a-device.md")
    (adapter,) = [code for kind, path, code in found if kind == "file" and "balance" in path]
    (said,) = [code for kind, _, code in found if kind == "contract"]
    (tmp_path / "gs_balance.py").write_text(adapter, encoding="utf-8")
    install(tmp_path, "gs-balance", {"gs": "gs_balance"}, balance.OFFERED)
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
    for _, path, code in [block for block in blocks("add-a-device.md") if block[1].startswith(("lumen", "pyproject"))]:
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(code, encoding="utf-8")
    project = tomllib.loads((tmp_path / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    install(tmp_path, project["name"], project["entry-points"][kinds.OFFERED], kinds.OFFERED)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(ROOT)]))
    plugins.offers.cache_clear()
    assert kinds.camera_kinds() == ("k4a", "realsense", "lumen")
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
    install(tmp_path, "torn", {"torn": "torn"}, kinds.OFFERED)
    monkeypatch.syspath_prepend(tmp_path)
    plugins.offers.cache_clear()
    with pytest.raises(DeviceUnavailable, match=r"torn of torn 1\.0 .*No module named 'no_such_sdk'"):
        CameraPart(kind="torn").camera()
    with pytest.raises(DeviceUnavailable, match=r"adapter torn:Device cannot be loaded .*no_such_sdk"):
        loaded("torn:Device", lambda: 0.0)
