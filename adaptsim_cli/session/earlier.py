"""Sessions of earlier formats as sessions of this one: a copy for reading, or one to keep (`sessions migrate`).

| format | written in November 2026 | differs from today's records |
|---|---|---|
| 1 | until the 22nd | no seals and SHA-256, no `motion.json` beside a tracked trial; and all of the next rows |
| 2 | until the 22nd | counted from 0 in names and records; a verdict is a sentence |
| 3, 4 | until the 26th | rows without names; `number` for today's `trial`, which counted within its particle |
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from adaptsim_cli.bench.facts import RigFacts
from adaptsim_cli.errors import SessionError, explained
from adaptsim_cli.session import records
from adaptsim_cli.session.about import ABOUT
from adaptsim_cli.session.folders import FACTS, entries, existing_folder, folder_of
from adaptsim_cli.session.records import Amendment, MotionRecord, Note, ResultRecord, SessionFacts, TrialRecord
from adaptsim_cli.session.store import MOTION, PRUNED, RESULT, START, SUMMARY, TRIAL, SessionStore
from adaptsim_cli.storage import durable
from hw.records import AnyRecord, from_any_version
from sim.adaptation.verdict import Kind, Reason
from sim.storage.files import permitted, publish_new, sha256

Table = dict[str, Any]

_UNSEALED = 1
_COUNTS_FROM_ZERO = 2
_ROWS = ("drawn_context", "context", "action")
_ITERATION = re.compile(r"iteration-(\d+)")
_ENTRY = re.compile(r"(trial-\d+-attempt-|result-)(\d+)(?:(\.[a-z]+)(?:-(\d+))?(\.json))?")
_OLD_SENTENCES = {
    "Too few trials": Kind.TOO_FEW,
    "Go on": Kind.GO_ON,
    "Stop here: no action": Kind.HOPELESS,
    "Stop here": Kind.ENOUGH,
    "Reward stays low": Kind.STAYS_LOW,
    "The reward is good all the same": Kind.NOT_CONVERGED,
    "Converged": Kind.CONVERGED,
    "Not converged yet": Kind.NOT_CONVERGED,
}
"""The beginnings of the sentences of formats 1 and 2. A longer one comes before a shorter one with which it begins."""


def is_earlier(folder: Path) -> bool:
    """Whether the session in `folder` has to be migrated before this version's commands can use it.

    Raises SessionError if its first record is missing or damaged.
    """
    if records.table(folder / FACTS, is_sealed=False).get("format", records.FORMAT) < records.FORMAT:
        return True
    first = next((file for name in (TRIAL, MOTION) for file in sorted(folder.glob(f"iteration-*/*/{name}"))), None)
    return first is not None and isinstance(records.table(first, is_sealed=False).get("context"), list)


@contextmanager
def readable(root: Path, name: str) -> Iterator[SessionStore]:
    """The session `name` of any format, for reading. Raises SessionError, UsageError.

    A session of an earlier format is read from a copy, which is removed afterwards; the copy's recordings are links.
    """
    folder = existing_folder(root, name)
    if not is_earlier(folder):
        yield SessionStore.open(root, name)
        return
    with tempfile.TemporaryDirectory() as elsewhere:
        _Migration.of(folder.absolute(), _linked).write(Path(elsewhere) / name)
        yield SessionStore.open(Path(elsewhere), name)


def migrate(root: Path, name: str, new_name: str) -> Path:
    """Write session `name` again as `new_name`, in this version's format, and return its folder.

    The old one stays as it is, with its log and its pages. Raises SessionError, also if there is nothing to migrate
    or `new_name` exists; UsageError on an impossible name.
    """
    folder, target = existing_folder(root, name), folder_of(root, new_name)
    if not is_earlier(folder):
        raise SessionError(f"session {name} is of this version's format: every command can use it as it is")
    with durable.explained(target):
        temporary = Path(tempfile.mkdtemp(prefix=f".{new_name}.", suffix=".writing", dir=root))
        try:
            _Migration.of(folder.absolute(), shutil.copyfile).write(temporary)
            temporary.chmod(permitted(0o777))
            publish_new(temporary, target)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    return target


def _linked(source: Path, target: Path) -> None:
    """Link one file; copy it if the file system of temporary files has no links."""
    try:
        target.symlink_to(source)
    except OSError:
        shutil.copyfile(source, target)


@dataclass(frozen=True)
class _Migration:
    """From one folder to another. A record is written only if this version can read it."""

    folder: Path
    facts: SessionFacts
    particles: Sequence[Any]  # of the iteration at hand: samples of each
    is_sealed: bool
    shift: int  # from its numbers to those from 1
    bring: Callable[[Path, Path], object]  # one file that is no record

    @classmethod
    def of(cls, folder: Path, bring: Callable[[Path, Path], object]) -> _Migration:
        table = records.table(folder / FACTS, is_sealed=False)
        version = table.get("format", records.FORMAT)
        is_sealed = version > _UNSEALED
        table = records.table(folder / FACTS, is_sealed=is_sealed) | {"format": records.FORMAT}
        table.pop("adaptsim_is", None)
        facts = _record(SessionFacts, table, folder / FACTS)
        start = records.table(folder / START, is_sealed=is_sealed)
        return cls(folder, facts, start["particles"], is_sealed, int(version <= _COUNTS_FROM_ZERO), bring)

    def write(self, target: Path) -> None:
        """Write the whole session into `target`, which may be an empty folder."""
        target.mkdir(exist_ok=True)
        (target / FACTS).write_bytes(records.to_toml(self.facts))
        self._put(target / START, records.SessionStart, {"particles": self.particles}, self.folder / START)
        if (self.folder / ABOUT).exists():
            self.bring(self.folder / ABOUT, target / ABOUT)
        iteration = self
        for entry in entries(self.folder):
            if match := _ITERATION.fullmatch(entry.name):
                number = int(match[1]) + self.shift
                iteration = iteration._iteration(entry, target / f"iteration-{number:02d}")

    def _iteration(self, source: Path, target: Path) -> _Migration:
        """Write one iteration, and return the migration of the next one."""
        target.mkdir()
        following = self
        for entry in entries(source):
            new = target / self._renamed(entry.name)
            if entry.is_file():
                kind = Amendment if ".amended" in entry.name else Note
                self._put(new, kind, self._table(entry), entry)
            elif (entry / RESULT).exists():
                following = replace(self, particles=self._result(entry, new))
            else:
                self._trial(entry, new)
        return following

    def _renamed(self, name: str) -> str:
        """The new name of a trial's or result's folder or marker, with numbers that begin at 1. Raises SessionError."""
        if not (match := _ENTRY.fullmatch(name)):
            raise records.corrupt(self.folder / name, "it does not belong to a session")
        before, number, kind, count, suffix = match.groups(default="")
        numbered = f"-{int(count) + self.shift}" if count else ""
        return f"{before}{int(number) + self.shift}{kind}{numbered}{suffix}"

    def _result(self, source: Path, target: Path) -> Any:
        """Write one result, and return the particles of the next iteration."""
        target.mkdir()
        table = self._table(source / RESULT)
        table["iteration"] += self.shift
        table["trials"] = [(number, attempt + self.shift) for number, attempt in table["trials"]]
        if isinstance(table["verdict"], str):
            table["verdict"] = _verdict(table)
        self.bring(source / SUMMARY, target / SUMMARY)
        table["summary_sha256"] = table.get("summary_sha256") or sha256(source / SUMMARY)
        self._put(target / RESULT, ResultRecord, table, source / RESULT)
        return table["next_particles"]

    def _trial(self, source: Path, target: Path) -> None:
        target.mkdir()
        others = [entry for entry in entries(source) if entry.name not in (MOTION, TRIAL, PRUNED)]
        for entry in others:
            if entry.name == records.RIG and not self.is_sealed:
                self._put(target / entry.name, RigFacts, self._table(entry), entry)
            else:
                self.bring(entry, target / entry.name)
        motion = self._table(source / MOTION) if (source / MOTION).exists() else {}
        trial = self._table(source / TRIAL) if (source / TRIAL).exists() else {}
        whole = self._proposed(source.name) | self._named(motion) | self._named(trial)
        whole["checksums"] = motion.get("checksums", {}) | trial.get("checksums", {})
        if not self.is_sealed:
            whole["checksums"] = {entry.name: sha256(target / entry.name) for entry in others}
            whole["files"] = {entry.name: (target / entry.name).stat().st_size for entry in others}
        if trial:
            self._put(target / TRIAL, TrialRecord, whole, source / TRIAL)
        moved = {key: value for key, value in whole.items() if key in MotionRecord.model_fields}
        if "checksums" in motion:
            moved["checksums"] = motion["checksums"]
        self._put(target / MOTION, MotionRecord, moved, source / MOTION)
        if (source / PRUNED).exists():
            self._put(target / PRUNED, records.Pruned, self._table(source / PRUNED), source / PRUNED)

    def _proposed(self, name: str) -> Table:
        """The place of a trial, from the name of its folder, and the fields that the first records did not have."""
        number, attempt = (int(part) for part in name.removeprefix("trial-").split("-attempt-"))
        index = self.facts.layout.iteration_of(number)
        within = number - self.facts.layout.numbers(index).start
        particle = within // self.facts.trials
        return {
            "trial": number,
            "attempt": attempt + self.shift,
            "iteration": index + 1,
            "particle": particle + 1,
            "goal_m": None,
            "parameters": self._quantities("parameters", np.mean(self.particles[particle], axis=0).tolist()),
        }

    def _named(self, table: Table) -> Table:
        """The record of a trial without its old numbers, and with names for its rows."""
        fields = {key: value for key, value in table.items() if key not in ("number", "trial", "attempt", "iteration")}
        if "particle" in fields:
            fields["particle"] += self.shift
        for row in _ROWS:
            if isinstance(fields.get(row), list):
                fields[row] = self._quantities(row.removeprefix("drawn_"), fields[row])
        return fields

    def _quantities(self, space: str, row: Sequence[float]) -> dict[str, float]:
        return dict(zip((d.name for d in getattr(self.facts, space)), row, strict=True))

    def _table(self, path: Path) -> Table:
        return records.table(path, is_sealed=self.is_sealed)

    def _put(self, target: Path, kind: type[AnyRecord], table: Mapping[str, Any], source: Path) -> None:
        target.write_bytes(records.to_json(_record(kind, table, source)))


def _record(kind: type[AnyRecord], table: Mapping[str, Any], source: Path) -> AnyRecord:
    try:
        return from_any_version(kind, table)
    except ValidationError as error:
        raise records.corrupt(source, explained(error)) from error


def _verdict(result: Table) -> Table:
    """The values of a verdict that formats 1 and 2 stored as a sentence."""
    sentence, best = result["verdict"], result["best"]
    outside = re.search(r"(\d+) of \d+ trajectories lie", sentence)
    return {
        "kind": next((kind for words, kind in _OLD_SENTENCES.items() if sentence.startswith(words)), Kind.UNKNOWN),
        "reasons": [Reason.INEXPRESSIBLE] if outside else [],
        "reward": best["mean_reward"],
        "ci95": best["ci95"],
        "trials": max(number for number, _ in result["trials"]),
        "strange": int(outside[1]) if outside else 0,
    }
