"""A task file as a setting: by a flag, from a user's file, and never unasked from the current folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from adaptsim_cli.bench.checkpoints import resolve
from adaptsim_cli.commands import settings
from adaptsim_cli.errors import UsageError
from sim.own.template import template
from sim.tasks import get_task


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    Path("mine.py").write_text(template("mine"), encoding="utf-8")
    return tmp_path


def test_a_flag_names_the_file_and_its_name_works_from_any_folder(folder, monkeypatch):
    assert resolve({"task": "mine.py"}).config.task == "mine"
    monkeypatch.chdir(folder)
    assert settings.load({"task": "mine", "world": "heavy"}).config.task == "mine"
    assert get_task("mine").file.path == str(folder / "work/mine.py")
    assert settings.load({"world": "heavy"}).config.task == "mine", "a world decides its task"


def test_without_a_world_the_first_of_the_task_is_taken(folder):
    text = template("mine").replace('"wd": dict', '"zebra": dict')
    Path("mine.py").write_text(text, encoding="utf-8")
    assert resolve({"task": "mine.py"}).config.world == "zebra"
    assert settings.load({"task": "mine"}).config.world == "zebra", "its name knows it too"
    assert settings.load({"task": "mine", "world": "heavy"}).config.world == "heavy"
    assert settings.load({"task": "mine", "world": "wd"}).config.world == "wd", (
        "a world that somebody names is not replaced"
    )


def test_a_file_of_the_users_settings_is_relative_to_them(folder):
    (folder / "home").mkdir()
    (folder / "home/config.toml").write_text('task = "mine.py"\n', encoding="utf-8")
    (folder / "home/mine.py").write_text(template("mine"), encoding="utf-8")
    assert resolve().config.task == "mine"
    assert get_task("mine").file.path == str(folder / "home/mine.py")


def test_a_file_of_the_current_folder_is_not_run_unasked(folder):
    Path("mine.py").write_text("raise SystemExit('it ran')", encoding="utf-8")
    Path("adaptsim.toml").write_text('task = "mine.py"\n', encoding="utf-8")
    with pytest.raises(UsageError, match=r"mine.py belongs to the current folder.*adaptsim config trust"):
        resolve()
