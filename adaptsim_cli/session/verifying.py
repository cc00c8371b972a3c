"""Reads every file of a session and names those that changed after writing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from adaptsim_cli.errors import SessionError
from adaptsim_cli.outputs.base import AnyRecord
from adaptsim_cli.session import recording, records
from adaptsim_cli.session.keeping import ABOUT, About
from adaptsim_cli.session.records import (
    Amendment,
    MotionRecord,
    Note,
    ResultRecord,
    TrialRecord,
)
from adaptsim_cli.session.store import MOTION, PRUNED, RESULT, SUMMARY, TRIAL, SessionStore, entries, folder_of
from sim.storage.files import sha256

T = TypeVar("T")


@dataclass(frozen=True)
class Verified:
    """One session, file by file."""

    session: str
    files: int  # number of files read
    damage: tuple[str, ...]  # one message per file

    def as_json(self) -> dict[str, Any]:
        """The object that `sessions verify --json` prints for a session."""
        return {
            "session": self.session,
            "files": self.files,
            "damage": list(self.damage),
        }


def verify(root: Path, name: str) -> Verified:
    """Read all of session `name` in `root`. Raises UsageError on an impossible name."""
    folder_of(root, name)
    try:
        store = SessionStore.open(root, name)
    except SessionError as error:
        return Verified(name, 1, (str(error),))
    examination = _Examination()
    examination.session(store)
    return Verified(name, examination.files, tuple(examination.damage))


class _Examination:
    """The files read so far, and the damage found."""

    def __init__(self) -> None:
        self.files = 0
        self.damage: list[str] = []

    def session(self, store: SessionStore) -> None:
        self.files += 2  # session.toml and start.json, read on opening
        if (store.folder / ABOUT).exists():
            self._record(About, store.folder / ABOUT)
        for folder in store.entries():
            for entry in entries(folder):
                if entry.is_file():
                    self._record(Amendment if ".amended" in entry.name else Note, entry)
                elif (entry / RESULT).exists():
                    self._result(entry)
                else:
                    self._trial(store, entry)
        self._look(_require_trials, store)

    def _result(self, folder: Path) -> None:
        result = self._record(ResultRecord, folder / RESULT)
        if result is not None:
            self._files(folder, {SUMMARY: result.summary_sha256})

    def _trial(self, store: SessionStore, folder: Path) -> None:
        motion = self._record(MotionRecord, folder / MOTION)
        pruned = self._look(store.pruned, folder) or {}
        if (folder / PRUNED).exists():
            self.files += 1
        recorded = {} if motion is None else motion.checksums
        checksums = {name: checksum for name, checksum in recorded.items() if name not in pruned}
        if not (folder / TRIAL).exists():  # derived files can be made again, the recording has to be whole
            self._files(folder, checksums, is_complete=False)
        elif (trial := self._record(TrialRecord, folder / TRIAL)) is not None:
            for name, size in trial.files.items():
                if name not in pruned:
                    self._look(records.require_size, folder / name, size)
            derived = {name: checksum for name, checksum in trial.checksums.items() if name not in pruned}
            self._files(folder, checksums | derived)

    def _files(self, folder: Path, checksums: Mapping[str, str], *, is_complete: bool = True) -> None:
        there = {entry.name for entry in entries(folder)} - {MOTION, TRIAL, RESULT, PRUNED}
        for name in sorted(there | set(checksums)):
            if name in checksums or is_complete:
                self.files += 1
                self._look(self._require_same, folder / name, checksums.get(name))

    def _require_same(self, path: Path, checksum: str | None) -> None:
        if checksum is None:
            raise records.corrupt(path, "it is in no record")
        if _sha256(path) != checksum:
            raise records.corrupt(path, "it was changed after it had been written: its SHA-256 is another")
        recording.require_whole(path)

    def _record(self, kind: type[AnyRecord], path: Path) -> AnyRecord | None:
        self.files += 1
        return self._look(records.read, kind, path)

    def _look(self, read: Callable[..., T], *arguments: Any) -> T | None:
        """The result of `read`; None if it found damage, which is noted."""
        try:
            return read(*arguments)
        except SessionError as error:
            self.damage.append(str(error))
            return None


def _sha256(path: Path) -> str:
    try:
        return sha256(path)
    except OSError as error:
        raise records.corrupt(path, error.strerror or str(error)) from error


def _require_trials(store: SessionStore) -> None:
    """Raises SessionError if a trial of a result is missing."""
    existing = store.existing()
    for iteration, keys in existing.results.items():
        for key in keys:
            if key not in existing.completed:
                raise records.corrupt(store.trial_folder(iteration, key), "it is missing, and a result rests on it")
