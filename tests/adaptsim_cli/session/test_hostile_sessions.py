"""What does not belong to a session: links out of it, pipes, cut logs, commands to the terminal."""

from __future__ import annotations

import io
import os
from pathlib import Path

import pytest
from rich.text import Text

from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.console import CleanConsole, Screen, clean
from adaptsim_cli.session import keeping, watching
from adaptsim_cli.session.store import entries, own_files


def session(folder: Path) -> Path:
    (folder / "iteration-01" / "trial-01").mkdir(parents=True)
    (folder / "iteration-01" / "trial-01" / "trial.json").write_text("{}")
    (folder / "log.jsonl").write_bytes(b"\xff\xfe broken\n")
    return folder


def test_links_and_pipes_are_no_part_of_a_session(tmp_path):
    folder, secret = session(tmp_path / "s"), tmp_path / "elsewhere"
    secret.mkdir()
    (secret / "recording.json").write_text("private")
    (folder / "linked").symlink_to(secret, target_is_directory=True)
    (folder / "linked.json").symlink_to(secret / "recording.json")
    os.mkfifo(folder / "pipe.json")
    assert {path.name for path in own_files(folder)} == {"trial.json", "log.jsonl"}
    assert {path.name for path in entries(folder)} == {"iteration-01", "log.jsonl"}
    files, _ = keeping.bundle(folder, tmp_path / "out.zip", {})  # hangs where a pipe is opened
    assert not any("linked" in name or "pipe" in name for name in files)
    assert keeping.size_bytes(folder) < 100


def test_an_archive_is_not_replaced_silently(tmp_path):
    folder = session(tmp_path / "s")
    keeping.bundle(folder, tmp_path / "out.zip", {})
    with pytest.raises(UsageError, match="--force"):
        keeping.bundle(folder, tmp_path / "out.zip", {})
    keeping.bundle(folder, tmp_path / "out.zip", {}, force=True)


def written(folder: Path, count: int = 4) -> Path:
    folder.mkdir()
    log = watching.SessionLog(folder, Screen(console=CleanConsole(file=io.StringIO())))
    for number in range(count):
        log.noted(f"line {number}")
    return folder / watching.FILE


@pytest.mark.parametrize("what", ["cut", "line removed", "line changed"])
def test_a_cut_or_changed_log_is_noticed(tmp_path, what):
    path = written(tmp_path / "s")
    lines = path.read_text().splitlines(keepends=True)
    kept = {
        "cut": lines[:2],
        "line removed": [lines[0], *lines[2:]],
        "line changed": [lines[0].replace("line 0", "line 9"), *lines[1:]],
    }[what]
    path.write_text("".join(kept))
    assert watching.damage(path.parent)
    told = io.StringIO()
    watching.SessionLog(path.parent, Screen(console=CleanConsole(file=told, width=300)))
    assert "was c" in told.getvalue()


def test_escape_sequences_never_reach_the_terminal():
    told = io.StringIO()
    screen = Screen(console=CleanConsole(file=told, width=200))
    for text in ("\x1b[2Jgone", "\x9b31m", "back\rwards", "bell\x07", "\x1b]0;title\x07"):
        screen.plain(text)
        screen.note(text)
        screen.show(Text(text))
    assert not any(one in told.getvalue() for one in "\x1b\x9b\r\x07")
    assert "\\x1b[2Jgone" in told.getvalue()
    assert clean("plain ° text\n") == "plain ° text\n"
