"""What does not belong to a session: links out of it, pipes, cut logs, commands to the terminal."""

from __future__ import annotations

import io
import os
from pathlib import Path

from adaptsim_cli.screen.console import CleanConsole, Screen
from adaptsim_cli.session import keeping, watching
from adaptsim_cli.session.store import entries, own_files


def session(folder: Path) -> Path:
    (folder / "iteration-01" / "trial-01").mkdir(parents=True)
    (folder / "iteration-01" / "trial-01" / "trial.json").write_text("{}")
    (folder / "log.jsonl").write_bytes(b"\xff\xfe broken\n")
    return folder


def test_links_and_pipes_are_no_part_of_a_session(tmp_path: Path) -> None:
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


def written(folder: Path, count: int = 4) -> Path:
    folder.mkdir()
    log = watching.SessionLog(folder, Screen(console=CleanConsole(file=io.StringIO())))
    for number in range(count):
        log.noted(f"line {number}")
    return folder / watching.FILE


def test_a_log_goes_on_also_behind_a_line_that_a_power_cut_truncated(tmp_path: Path) -> None:
    path = written(tmp_path / "s")
    path.write_text(path.read_text() + '{"at": "2026')
    assert watching.damage(path.parent) == ""
    watching.SessionLog(path.parent, Screen(console=CleanConsole(file=io.StringIO()))).noted("later")
    assert watching.damage(path.parent) == ""
