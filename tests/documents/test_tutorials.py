"""The code of the two tutorials, taken from the pages, against the contracts of every task and of every balance."""

from __future__ import annotations

import importlib.util
import inspect
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from hw.serial import balance
from sim import tasks
from sim.lab import world
from sim.tasks.task import Task

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^<!-- (\w+) (\S+) -->\n```\w+\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(page: str) -> list[tuple[str, str, str]]:
    """(kind, path, code) of the marked code of a page, in order."""
    return BLOCK.findall((ROOT / "docs/guide" / page).read_text(encoding="utf-8"))


def module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"tutorial_{path.parent.name}_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = made
    spec.loader.exec_module(made)
    return made


@pytest.fixture
def curling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Task]:
    """The task of the tutorial, registered by its line, with its worlds, for as long as a test runs."""
    lines = []
    for kind, path, code in blocks("add-a-task.md"):
        if kind == "line":
            lines.append(code)
            continue
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(code, encoding="utf-8")
    (line,) = lines
    assert line.strip() == '"curling": "sim.tasks.curling",'
    made = module(tmp_path / "sim/tasks/curling/__init__.py")
    monkeypatch.setitem(sys.modules, "sim.tasks.curling", made)
    monkeypatch.setitem(tasks.TASKS, "curling", "sim.tasks.curling")
    shipped = world._folder
    monkeypatch.setattr(
        world, "_folder", lambda task: tmp_path / "sim/worlds/curling" if task.name == "curling" else shipped(task)
    )
    yield tasks.get_task("curling")


def test_the_task_of_the_tutorial_keeps_the_contract_of_every_task(curling: Task) -> None:
    contract = module(ROOT / "tests/contracts/test_task_contract.py")
    tests = [
        f
        for name, f in vars(contract).items()
        if name.startswith("test_") and list(inspect.signature(f).parameters) == ["task"]
    ]
    assert len(tests) >= 5
    for test in tests:
        test(curling)


@pytest.mark.slow
def test_the_task_of_the_tutorial_is_used_as_the_page_says(tmp_path: Path) -> None:
    """In a copy of the packages: pretrained (with a smaller budget), then every command of the page."""
    copy = tmp_path / "copy"
    for package in ("adaptsim_cli", "calib", "hw", "perception", "sim"):
        shutil.copytree(ROOT / package, copy / package, ignore=shutil.ignore_patterns("__pycache__", "checkpoints"))
    for kind, path, code in blocks("add-a-task.md"):
        target = copy / path
        target.parent.mkdir(parents=True, exist_ok=True)
        before = (
            target.read_text(encoding="utf-8").replace("TASKS = {\n", "TASKS = {\n" + code) if kind == "line" else code
        )
        target.write_text(before, encoding="utf-8")
    page = (ROOT / "docs/guide/add-a-task.md").read_text(encoding="utf-8")
    pretrain, rollout, iteration = re.findall(r"^adaptsim (.*)$", page, re.MULTILINE)
    assert pretrain == "pretrain --task curling --budget small"
    quick = "pretrain --task curling --rollouts 512 --steps 64 --judged 4 --workers 1"
    env = {**os.environ, "ADAPTSIM_HOME": str(tmp_path / "home"), "PYTHONPATH": str(copy), "OMP_NUM_THREADS": "1"}
    for line in (quick, rollout, iteration):
        command = [sys.executable, "-c", "from adaptsim_cli.app import main; main()", *line.split()]
        done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"


def test_the_balance_of_the_tutorial_keeps_the_contract_of_every_balance(monkeypatch: pytest.MonkeyPatch) -> None:
    found = blocks("add-a-device.md")
    (adapter,) = [code for kind, _, code in found if kind == "file"]
    (said,) = [code for kind, _, code in found if kind == "contract"]
    monkeypatch.setattr(balance, "PROTOCOLS", dict(balance.PROTOCOLS))
    contract = module(ROOT / "tests/contracts/test_balance_contract.py")
    exec(adapter, {"__name__": "tutorial"})
    exec(said, vars(contract))
    laden = contract.KINDS["gs"]
    tests = [
        f
        for name, f in vars(contract).items()
        if name.startswith("test_") and list(inspect.signature(f).parameters) == ["laden"]
    ]
    assert len(tests) >= 4
    for test in tests:
        test(laden)
