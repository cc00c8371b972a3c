from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from adaptsim_cli.errors import DiskFull, SessionError
from adaptsim_cli.storage import durable


def full_disk(_: int) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_folder_appears_whole(place):
    durable.write_folder(place / "trial", {"a.bin": b"1", "b.json": b"{}"})
    assert {f.name: f.read_bytes() for f in (place / "trial").iterdir()} == {"a.bin": b"1", "b.json": b"{}"}
    assert [entry.name for entry in place.iterdir()] == ["trial"]


def test_nothing_is_ever_overwritten(tmp_path):
    durable.write_file(tmp_path / "a", b"first")
    with pytest.raises(SessionError, match="never overwritten"):
        durable.write_file(tmp_path / "a", b"second")
    assert (tmp_path / "a").read_bytes() == b"first"


def test_of_two_who_write_the_same_file_the_second_is_told(place, monkeypatch):
    """Also where the first finishes between the second's look and its last step."""
    monkeypatch.setattr(Path, "exists", lambda _: False)
    for write, content in ((durable.write_file, b"1"), (durable.write_folder, {"a": b"1"})):
        name = write.__name__
        write(place / name, content)  # type: ignore[arg-type]
        with pytest.raises(SessionError, match="never overwritten"):
            write(place / name, content)  # type: ignore[arg-type]
    assert sorted(entry.name for entry in place.iterdir()) == ["write_file", "write_folder"]


def test_a_file_system_without_second_names_does_too(tmp_path, monkeypatch):
    def unsupported(*_: object) -> None:
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(os, "link", unsupported)
    durable.write_file(tmp_path / "a", b"1")
    assert (tmp_path / "a").read_bytes() == b"1"
    with pytest.raises(SessionError, match="never overwritten"):
        durable.write_file(tmp_path / "a", b"2")


def test_a_full_disk_leaves_nothing_under_the_final_name(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(DiskFull, match=r"trial could not be written.*run the same command again"):
        durable.write_folder(tmp_path / "trial", {"a": b"1"})
    monkeypatch.undo()
    assert not (tmp_path / "trial").exists()
    durable.write_folder(tmp_path / "trial", {"b": b"2"})
    assert [f.name for f in (tmp_path / "trial").iterdir()] == ["b"], (
        "the leftovers of the failed write must not remain"
    )


def test_contents_reach_the_disk_before_the_name_does(tmp_path, monkeypatch):
    events: list[str] = []

    def noted(name: str, call: Callable[..., None]) -> Callable[..., None]:
        def also(*arguments: Any) -> None:
            events.append(name)
            call(*arguments)

        return also

    monkeypatch.setattr(os, "fsync", noted("fsync", os.fsync))
    monkeypatch.setattr(os, "rename", noted("rename", os.rename))
    durable.write_folder(tmp_path / "trial", {"a": b"1", "b": b"2"})
    assert events == ["fsync", "fsync", "fsync", "rename", "fsync"]  # two files, their folder; then the parent


def test_a_folder_is_complete_when_its_record_is_there(tmp_path, monkeypatch):
    durable.write_folder(tmp_path / "trial", {"recording": b"0"})
    link = os.link

    def no_room_for_the_record(old: Path, new: Path) -> None:
        link(old, new) if new.name != "record" else full_disk(0)

    with monkeypatch.context() as patch, pytest.raises(DiskFull):
        patch.setattr(os, "link", no_room_for_the_record)
        durable.complete_folder(tmp_path / "trial", {"image": b"1"}, "record", b"2")
    assert not (tmp_path / "trial" / "record").exists()
    durable.complete_folder(tmp_path / "trial", {"image": b"1"}, "record", b"2")
    kept = {"recording": b"0", "image": b"1", "record": b"2"}
    assert {f.name: f.read_bytes() for f in (tmp_path / "trial").iterdir()} == kept
    with pytest.raises(SessionError, match="exists already"):
        durable.complete_folder(tmp_path / "trial", {}, "record", b"3")
