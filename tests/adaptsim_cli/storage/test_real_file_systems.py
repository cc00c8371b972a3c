"""Storage and commands on file systems as they are: full, read-only, without links or locks; a clock that
goes backwards, and the end of summer time.
"""

from __future__ import annotations

import errno
import fcntl
import io
import json
import os
import stat
import subprocess
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path

import pytest
from lab_session import digest_of
from toy_rig import ToyLab
from toy_session import RUN, call

from adaptsim_cli.session import correcting, records

Mount = Callable[[str], Path]


@pytest.fixture
def mount(tmp_path: Path) -> Iterator[Mount]:
    """A small file system in memory with these options."""
    there: list[Path] = []

    def mounted(options: str) -> Path:
        folder = tmp_path / f"mounted-{len(there)}"
        folder.mkdir()
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)], capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            pytest.skip(f"this machine permits no mounts: {done.stderr.strip()}")
        there.append(folder)
        return folder

    yield mounted
    for folder in there:
        subprocess.run(["umount", str(folder)], check=True)


def test_a_session_on_a_disk_that_fills_up_goes_on_once_there_is_room(mount: Mount, tmp_path: Path) -> None:
    (tmp_path / "adaptsim.toml").write_text("min_free_mb = 0\n")  # it is refused before the arm moves otherwise
    whole = tmp_path / "whole"
    assert call(whole, RUN)[0] == 0
    taken = sum(path.stat().st_size for path in (whole / "data").rglob("*") if path.is_file())
    home = mount(f"size={taken // 2}")
    code, said = call(home, RUN)
    assert code == 8, said
    assert "the disk is full: " in said
    assert "free some space and run the same command again" in said
    kept = {path: path.read_bytes() for record in home.rglob("trial.json") for path in record.parent.iterdir()}
    subprocess.run(["mount", "-o", "remount,size=100m", str(home)], check=True)
    code, said = call(home, RUN)
    assert code == 0, said
    assert {path: path.read_bytes() for path in kept} == kept
    assert digest_of(home / "data" / "sessions") == digest_of(whole / "data" / "sessions")
    assert call(home, ("sessions", "verify", "s"))[0] == 0


READING: tuple[tuple[str, ...], ...] = (("sessions", "list"), ("sessions", "show", "s"), ("sessions", "verify", "s"))
WRITING: tuple[tuple[str, ...], ...] = (
    RUN,
    ("sessions", "mark", "s", "--note", "the lamp"),
)


def test_commands_on_a_mount_that_is_read_only_read_and_move_nothing(mount: Mount) -> None:
    home = mount("size=1g")
    assert call(home, RUN)[0] == 0
    before = digest_of(home / "data")
    subprocess.run(["mount", "-o", "remount,ro", str(home)], check=True)
    for command in READING:
        code, said = call(home, command)
        assert (code, "Error" in said) == (0, False), (command, said)
    lab = ToyLab(7)
    for command in WRITING:
        code, said = call(home, command, lab)
        assert code == 8, (command, said)
        assert "Read-only" in said, command
    assert lab.executions == []
    assert digest_of(home / "data") == before


@pytest.mark.long
def test_a_session_whose_clock_goes_backwards_ends_like_any_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, home = tmp_path / "whole", tmp_path / "backwards"
    assert call(whole, RUN)[0] == 0
    calls = []

    class Backwards(datetime):
        @classmethod
        def now(cls, tz: tzinfo | None = None) -> datetime:  # type: ignore[override]
            calls.append(tz)
            return datetime(2024, 1, 1, tzinfo=UTC) - timedelta(hours=len(calls))

    def interrupt(trial: int, attempt: int) -> None:
        if trial == 2:
            raise KeyboardInterrupt

    for module in (records, correcting):
        monkeypatch.setattr(module, "datetime", Backwards)
    assert call(home, RUN, ToyLab(7, hooks={"stop_recording": interrupt}))[0] == 130
    assert call(home, RUN)[0] == 0
    assert len(calls) > 10
    assert digest_of(home / "data" / "sessions") == digest_of(whole / "data" / "sessions")
    assert call(home, ("sessions", "verify", "s"))[0] == 0


@pytest.mark.long
def test_a_session_over_the_end_of_summer_time_counts_in_utc(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In Berlin, the hour from 2:00 to 3:00 comes twice on 25 October 2026: first as UTC+2, then as UTC+1."""
    monkeypatch.setenv("TZ", "Europe/Berlin")
    time.tzset()
    calls = []

    class OverTheHour(datetime):
        @classmethod
        def now(cls, tz: tzinfo | None = None) -> datetime:  # type: ignore[override]
            calls.append(tz)
            return (datetime(2026, 10, 25, 0, 30, tzinfo=UTC) + timedelta(minutes=10 * len(calls))).astimezone(tz)

    try:
        for module in (records, correcting):
            monkeypatch.setattr(module, "datetime", OverTheHour)
        assert call(tmp_path, RUN)[0] == 0
        assert call(tmp_path, tuple("later" if word == "s" else word for word in RUN))[0] == 0
        out = io.StringIO()
        assert call(tmp_path, ("sessions", "list", "--json"), out=out)[0] == 0
        assert call(tmp_path, ("sessions", "verify"))[0] == 0
    finally:
        monkeypatch.delenv("TZ")
        time.tzset()
    assert set(calls) == {UTC}, "every stored time says its offset, which is 0"
    sessions = json.loads(out.getvalue())["sessions"]
    assert [session["session"] for session in sessions] == ["s", "later"], "the newest is the last"
    created = [datetime.fromisoformat(session["created"]) for session in sessions]
    assert created == sorted(created)


def test_a_session_on_a_stick_without_hard_links_and_flushed_folders(tmp_path: Path, monkeypatch) -> None:
    """As exFAT, and some network shares."""
    fsync = os.fsync

    def no_links(*_: object) -> None:
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    def files_alone(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        fsync(descriptor)

    monkeypatch.setattr(os, "link", no_links)
    monkeypatch.setattr(os, "fsync", files_alone)
    code, said = call(tmp_path, RUN)
    assert code == 0, said
    assert call(tmp_path, ("sessions", "verify", "s"))[0] == 0


def test_a_file_system_without_locks_is_refused_with_the_setting_to_change(tmp_path: Path, monkeypatch) -> None:
    def no_locks(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", no_locks)
    code, said = call(tmp_path, RUN)
    assert code != 0
    assert "file system without locks" in said
    assert "set ADAPTSIM_HOME to a folder on a local disk" in said
