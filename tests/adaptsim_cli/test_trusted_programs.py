"""Programs of the current folder that answer for a robot: what is bound, and when a person is asked."""

from __future__ import annotations

import json
import os
import shlex
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from own_robot import ROBOT, program, run
from real_lab import quiet, said, typing

from adaptsim_cli import config, trust
from adaptsim_cli.errors import UsageError
from adaptsim_cli.session.own.trust import require_trusted


def own_robot(*, yes: bool = True) -> None:
    """As a session begins: returns if the program may run."""
    require_trusted(config.load(), quiet(), yes=yes)


def named(command: str) -> None:
    Path("adaptsim.toml").write_text(f"hw = 'own'\nanswer_with = {json.dumps(command)}\n")


COMMANDS = {
    "python3 -m r": "r.py",
    "python3 rdir": "rdir/__main__.py",
    "make trial": "Makefile",
    "sh -c './r.sh go'": "r.sh",
    "python3 launch.py --cfg=conf.yaml": "conf.yaml",
    "python3 r.py": "helper/deep.py",
}


@pytest.mark.parametrize(("command", "file"), COMMANDS.items())
def test_every_file_that_a_program_of_the_folder_can_reach_is_bound(command, file, place, monkeypatch):
    named(command)
    Path(file).parent.mkdir(exist_ok=True)
    Path(file).write_text("1")
    typing(monkeypatch, "y")
    own_robot(yes=False)
    own_robot()
    (place / ".git").mkdir()
    (place / ".git" / "index").write_text("1")
    own_robot()
    for change in (lambda: Path(file).write_text("2"), lambda: Path("json.py").write_text("a new one shadows")):
        change()
        with pytest.raises(UsageError):
            own_robot()
        typing(monkeypatch, "y")
        own_robot(yes=False)


def test_links_and_paths_elsewhere_are_bound_too(place, monkeypatch):
    far = place.parent / "far"
    far.mkdir()
    for name in ("a.py", "b.py"):
        (far / name).write_text(name)
    (far / "lib").mkdir()
    Path("link.py").symlink_to(far / "a.py")
    Path("lib").symlink_to(far / "lib")
    Path("loop").symlink_to(place)
    named(f"python3 link.py --with={far / 'b.py'}")

    def retarget() -> None:
        Path("link.py").unlink()
        Path("link.py").symlink_to(far / "b.py")

    changes: tuple[Callable[[], object], ...] = (
        lambda: (far / "a.py").write_text("changed"),
        lambda: (far / "b.py").write_text("changed"),
        lambda: (far / "lib" / "new.py").write_text("new"),
        retarget,
        (far / "b.py").unlink,
    )
    for change in changes:
        with suppress(UsageError):
            own_robot()
            raise AssertionError("it ran unasked")
        typing(monkeypatch, "y")
        own_robot(yes=False)
        own_robot()
        change()
    with pytest.raises(UsageError):
        own_robot()


@pytest.mark.parametrize("beyond", ["files", "bytes", "unreadable"])
def test_beyond_the_bound_only_the_command_is_trusted_and_the_question_says_so(beyond, place, monkeypatch):
    named("python3 r.py")
    Path("r.py").write_text("1")
    Path("b.py").write_text(200 * "2")
    if beyond == "unreadable":
        Path("s").symlink_to("s")  # a circle: the system refuses to open it
    else:
        monkeypatch.setattr(trust, *(("MOST_FILES", 2) if beyond == "files" else ("MOST_BYTES", 200)))
    screen = quiet()
    typing(monkeypatch, "y")
    require_trusted(config.load(), screen, yes=False)
    assert "Only the command itself is confirmed, for this folder" in said(screen)
    assert "so a later change of its files is NOT noticed" in said(screen)
    Path("r.py").write_text("2")
    own_robot()
    named("python3 r.py --fast")
    with pytest.raises(UsageError):
        own_robot()
    named("python3 r.py")
    own_robot()
    copy = place.parent / "copy"
    place.rename(copy)
    monkeypatch.chdir(copy)
    with pytest.raises(UsageError, match="Only the command itself"):
        own_robot()


def test_a_program_that_imports_leaves_nothing_in_its_folder_that_would_end_its_trust(place, monkeypatch):
    Path("helper.py").write_text("import json\n")
    Path("robot.py").write_text("from helper import json\n" + ROBOT.replace("RUNS", "'../runs.txt'"))
    named(f"{shlex.quote(sys.executable)} robot.py")
    typing(monkeypatch, "y")
    own_robot(yes=False)
    run(place.parent / "home", program(config.load().config.answer_with))
    assert (place.parent / "runs.txt").read_text().count("trial") == 4
    own_robot()


ENV = {"ADAPTSIM_ANSWER_MOVES": "nothing"}


@pytest.mark.parametrize(
    ("user", "project", "env", "flags", "moves"),
    [
        ('answer_with = "r"\n', "", {}, {}, "robot"),
        ('answer_with = "r"\n', "", ENV, {}, "robot"),
        ('answer_with = "r"\n', 'answer_moves = "nothing"\n', {}, {}, "robot"),
        ('answer_with = "r"\nanswer_moves = "nothing"\n', "", {}, {}, "nothing"),
        ('answer_with = "r"\nanswer_moves = "nothing"\n', 'answer_with = "s"\n', {}, {}, "robot"),
        ('answer_moves = "nothing"\n', 'answer_with = "s"\n', {}, {}, "robot"),
        ("", 'answer_with = "s"\nanswer_moves = "nothing"\n', {}, {}, "nothing"),
        ("", 'answer_with = "s"\n', ENV, {}, "robot"),
        ("", "", {**ENV, "ADAPTSIM_ANSWER_WITH": "e"}, {}, "nothing"),
        ("", "", ENV, {"answer_with": "f"}, "robot"),
        ('answer_with = "r"\n', "", {}, {"answer_moves": "nothing"}, "nothing"),
        ("", "", {}, {"answer_with": "f", "answer_moves": "nothing"}, "nothing"),
    ],
)
def test_a_program_moves_nothing_only_where_its_own_place_or_a_flag_says_so(user, project, env, flags, moves, place):
    home = place.parent / "home"
    home.mkdir()
    (home / "config.toml").write_text(user)
    Path("adaptsim.toml").write_text(project)
    assert config.load(flags, {**os.environ, **env}).config.answer_moves == moves


def test_a_program_of_the_users_own_settings_is_asked_about_where_it_names_files_of_the_folder(place, monkeypatch):
    home = place.parent / "home"
    home.mkdir()
    far = place.parent / "far.py"
    far.write_text("1")
    for command in (f"python3 {far}", "my-robot", "python3 r.py", "python3 -m r"):
        (home / "config.toml").write_text(f'hw = "own"\nanswer_with = "{command}"\n')
        own_robot()
    Path("r.py").write_text("somebody else's")
    for command in ("python3 r.py", "python3 -m r", "sh -c './r.py'"):
        (home / "config.toml").write_text(f'hw = "own"\nanswer_with = "{command}"\n')
        with pytest.raises(UsageError, match="which moves robot"):
            own_robot()
    (home / "config.toml").write_text(f'hw = "own"\nanswer_with = "python3 {far}"\n')
    own_robot()
    Path("adaptsim.toml").write_text('hw = "own"\nanswer_moves = "nothing"\n')
    with pytest.raises(UsageError, match='It sets hw = "own", answer_moves = "nothing"'):
        own_robot()
