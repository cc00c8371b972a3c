"""Storage on file systems as they really are: full, read-only, of somebody else; and a clock that goes backwards."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from adaptsim_cli.errors import DiskFull, SessionError
from adaptsim_cli.storage import durable
from adaptsim_cli.storage.locking import locked

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


def test_a_mount_that_is_read_only_is_said_before_anything_is_done(mount: Mount) -> None:
    folder = mount("size=1m,ro")
    with pytest.raises(SessionError, match="could not be written: Read-only file system"):
        durable.require_writable(folder)
    with pytest.raises(SessionError, match="Read-only file system"):
        durable.write_file(folder / "file", b"1")
    with (
        pytest.raises(SessionError, match="cannot be locked: Read-only file system; may you write there"),
        locked(folder, "taken"),
    ):
        pass


AS_ANOTHER = """
import os, sys
from pathlib import Path
from adaptsim_cli.errors import SessionError
from adaptsim_cli.storage import durable
from adaptsim_cli.storage.locking import locked
os.setresuid(65534, 65534, 65534)
folder = Path(sys.argv[1])
for attempt in (
    lambda: durable.write_file(folder / "file", b"1"),
    lambda: durable.replace_file(folder / "theirs", b"1"),
    lambda: locked(folder, "taken").__enter__(),
):
    try:
        attempt()
    except SessionError as error:
        print(error)
"""


def test_the_files_of_another_user_are_left_alone_and_it_is_said(tmp_path: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("only root can act as another user")
    folder = tmp_path / "shared"
    folder.mkdir(mode=0o755)
    (folder / "theirs").write_bytes(b"0")
    for above in [tmp_path, *tmp_path.parents]:
        if str(above) not in ("/", "/tmp"):
            above.chmod(above.stat().st_mode | 0o055)
    done = subprocess.run(
        [sys.executable, "-c", AS_ANOTHER, str(folder)],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])},
    )
    first, second, third = done.stdout.splitlines()
    assert "file could not be written: Permission denied. " in first
    assert "theirs could not be written: Permission denied. " in second
    assert third.endswith("cannot be locked: Permission denied; may you write there?")
    assert sorted(path.name for path in folder.iterdir()) == ["theirs"]
    assert (folder / "theirs").read_bytes() == b"0"


def test_a_clock_that_goes_backwards_loses_and_replaces_nothing(tmp_path: Path) -> None:
    durable.write_folder(tmp_path / "a", {"x": b"1"})
    future_s = time.time() + 86_400.0
    os.utime(tmp_path / "a" / "x", (future_s, future_s))
    with pytest.raises(SessionError, match="exists already"):
        durable.write_folder(tmp_path / "a", {"x": b"2"})
    durable.replace_file(tmp_path / "a" / "x", b"3")
    assert (tmp_path / "a" / "x").read_bytes() == b"3"
    assert (tmp_path / "a" / "x").stat().st_mtime < future_s
