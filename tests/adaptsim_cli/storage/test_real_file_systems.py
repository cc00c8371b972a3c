"""Storage and commands on file systems as they are: full, read-only, of somebody else; a clock that goes backwards."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path

import pytest
from lab_session import digest_of
from toy_rig import ToyLab
from toy_session import RUN, call

from adaptsim_cli.errors import DiskFull, SessionError
from adaptsim_cli.session import flow, running, watching
from adaptsim_cli.storage import durable
from adaptsim_cli.storage.durable import locked

Mount = Callable[[str], Path]
NOBODY = 65534


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


def test_a_disk_that_is_full_keeps_what_was_whole_and_takes_it_up_again(mount: Mount) -> None:
    folder = mount("size=1m")
    durable.write_folder(folder / "first", {"a": b"1" * 200_000, "b": b"2"})
    with pytest.raises(DiskFull, match=r"the disk is full: .*second.* free some space and run the same command again"):
        durable.write_folder(folder / "second", {"a": b"1" * 500_000, "b": b"2" * 500_000})
    assert sorted(path.name for path in folder.iterdir()) == ["first"], "nothing half, and no leftovers"
    assert (folder / "first" / "a").stat().st_size == 200_000
    with pytest.raises(DiskFull):
        durable.write_file(folder / "file", b"1" * 2_000_000)
    durable.write_folder(folder / "second", {"a": b"1" * 100_000})


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
    ("sessions", "mark", "s", "--archive"),
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


def test_a_mount_that_is_read_only_is_said_before_anything_is_done(mount: Mount) -> None:
    folder = mount("size=1m,ro")
    with pytest.raises(SessionError, match="Read-only"):
        durable.require_writable(folder)
    with pytest.raises(SessionError, match="Read-only"):
        durable.write_file(folder / "file", b"1")
    with (
        pytest.raises(SessionError, match="cannot be locked: Read-only file system; check that you may write there"),
        locked(folder, "taken"),
    ):
        pass


COMMANDS_AS_ANOTHER = """
import json, os, sys
from pathlib import Path
from toy_session import RUN, call
from toy_rig import ToyLab
home, lab, commands = Path(sys.argv[1]), ToyLab(7), json.loads(sys.argv[2])
for command in [RUN, *commands]:  # loads all modules, which the other user may not be able to
    call(home.with_name("own"), command)
os.setresuid(65534, 65534, 65534)
outcomes = [call(home, command, lab) for command in commands]
print(json.dumps([outcomes, lab.executions]))
"""


@pytest.mark.long
def test_the_session_of_another_user_is_read_and_left_alone(tmp_path: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("only root can act as another user")
    home = tmp_path / "shared"
    assert call(home, RUN)[0] == 0
    before = digest_of(home / "data")
    for above in [tmp_path, *tmp_path.parents]:
        if str(above) not in ("/", "/tmp"):
            above.chmod(above.stat().st_mode | 0o055)
    root = Path(__file__).parents[3]
    done = subprocess.run(
        [sys.executable, "-B", "-c", COMMANDS_AS_ANOTHER, str(home), json.dumps([*READING, *WRITING])],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": os.pathsep.join((str(root), str(root / "tests" / "support")))},
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    outcomes, moved = json.loads(done.stdout)
    for code, said in outcomes[: len(READING)]:
        assert (code, "Error" in said) == (0, False), said
    for code, said in outcomes[len(READING) :]:
        assert code == 8, said
        assert "Permission denied" in said
    assert moved == []
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

    for module in (running, flow, watching):
        monkeypatch.setattr(module, "datetime", Backwards)
    assert call(home, RUN, ToyLab(7, hooks={"stop_recording": interrupt}))[0] == 130
    assert call(home, RUN)[0] == 0
    assert len(calls) > 10
    assert digest_of(home / "data" / "sessions") == digest_of(whole / "data" / "sessions")
    assert call(home, ("sessions", "verify", "s"))[0] == 0
