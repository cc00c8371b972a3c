"""A session as a folder: `session.toml`, `start.json`, and one folder per iteration. See docs/reference/sessions.md."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path

from adaptsim_cli.bench.facts import RigFacts
from adaptsim_cli.session import records
from adaptsim_cli.session.folders import FACTS, OVERLAY, entries, existing_folder, folder_of, session_parts
from adaptsim_cli.session.records import (
    Amendment,
    MotionRecord,
    Note,
    Pruned,
    ResultRecord,
    SessionFacts,
    SessionStart,
    Started,
    TrialRecord,
)
from adaptsim_cli.storage import durable
from adaptsim_cli.storage.durable import locked
from hw.records import AnyRecord, Record
from sim.adaptation.stages import Existing, Role, TrialKey, current_key

START = "start.json"
_TRIAL = re.compile(r"trial-(\d+)-attempt-(\d+)(?:\.(started|rejected|restored|amended)(?:-(\d+))?\.json)?")
_RESULT = re.compile(r"result-(\d+)(\.shown\.json)?")
MOTION, TRIAL, PRUNED = "motion.json", "trial.json", "pruned.json"
"""The records of a trial: its motion, its result, and recordings removed to make room."""
RESULT, SUMMARY = "result.json", "summary.json"

_CREATION_S = 5.0
"""How long a command waits while another one begins a session."""

_CHANGES: dict[str, type[Note]] = {"restored": Note, "amended": Amendment}
"""Markers that change the basis of earlier results."""


@dataclass(frozen=True)
class Change:
    """A change by the operator: an attempt rejected or restored, or an outcome amended."""

    key: TrialKey
    note: Note


@dataclass(frozen=True)
class SessionStore:
    """An existing session. Reading checks every record; writing is durable and never overwrites."""

    folder: Path
    facts: SessionFacts
    start: SessionStart
    _read: dict[Path, Record] = field(default_factory=dict, repr=False, compare=False)  # trials and results, by file
    _most: int | None = None  # iterations that are looked at; None: all
    begun_as: str = ""  # its name in its own record, if its folder has another

    @classmethod
    def create(cls, root: Path, facts: SessionFacts, start: SessionStart) -> SessionStore:
        """Create the folder of a new session in `root`. Raises UsageError on a bad name, SessionError, DiskFull.

        If two commands begin the same session at once, the second one raises SessionError.
        """
        folder = folder_of(root, facts.name)
        durable.make_folder(root)
        refusal = f"another session is just being begun in {root}; run the same command again"
        with locked(root, refusal, wait_s=_CREATION_S):
            durable.write_folder(folder, {FACTS: records.to_toml(facts), START: records.to_json(start)})
        return cls(folder, facts, start)

    @classmethod
    def open(cls, root: Path, name: str) -> SessionStore:
        """Open a session; a renamed or copied one has its folder's name. Raises SessionError if missing or corrupt."""
        folder = existing_folder(root, name)
        facts = records.read(SessionFacts, folder / FACTS)
        begun_as = "" if facts.name == name else facts.name
        facts = facts.model_copy(update={"name": name})
        return cls(folder, facts, records.read(SessionStart, folder / START), begun_as=begun_as)

    def until(self, iterations: int) -> SessionStore:
        """Only the first `iterations`, which stay as they are while the session continues."""
        return replace(self, _most=iterations)

    def additions(self) -> tuple[str, ...]:
        """The keys that a newer version wrote into the records read so far."""
        records_read = (self.facts, self.start, *self._read.values())
        return tuple(dict.fromkeys(key for record in records_read for key in record.additions))

    def existing(self, iteration: int | None = None) -> Existing:
        """The stored contents, of all iterations or of one. Raises SessionError on names that do not belong there."""
        completed: set[TrialKey] = set()
        recorded: set[TrialKey] = set()
        started: set[TrialKey] = set()
        rejections: Counter[TrialKey] = Counter()  # minus those taken back
        results: dict[int, tuple[TrialKey, ...]] = {}
        changes: Counter[int] = Counter()
        counted: dict[int, int] = {}
        shown = set()
        chosen = self._iterations() if iteration is None else [(iteration, self.iteration_folder(iteration))]
        for number, folder in chosen:
            listed = entries(folder)
            for entry in listed:
                if match := _TRIAL.fullmatch(entry.name):
                    key, kind = _key(match), match[3]
                    if kind is None:
                        (completed if (entry / TRIAL).exists() else recorded).add(key)
                    elif kind == "started":
                        started.add(key)
                    elif kind == "rejected":
                        rejections[key] += 1
                    else:
                        rejections[key] -= kind == "restored"
                        changes[number] += 1
                elif not _RESULT.fullmatch(entry.name):
                    raise records.corrupt(entry, "it does not belong to a session")
            if count := _results(listed):
                result = self._once(ResultRecord, folder / f"result-{count}" / RESULT)
                results[number] = result.keys
                counted[number] = result.changes
                if folder / _shown_mark(count) in listed:
                    shown.add(number)
        return Existing(
            completed=frozenset(completed),
            started=frozenset(started),
            recorded=frozenset(recorded),
            rejected=frozenset(key for key, times in rejections.items() if times > 0),
            results=results,
            changes=changes,
            counted=counted,
            shown=frozenset(shown),
        )

    def motion(self, iteration: int, key: TrialKey) -> MotionRecord:
        """The record of a finished motion. Raises SessionError if it is missing or corrupt."""
        return records.read(MotionRecord, self.trial_folder(iteration, key) / MOTION)

    def trial(self, iteration: int, key: TrialKey) -> TrialRecord:
        """A completed trial. Raises SessionError if a file beside it is missing or truncated."""
        folder = self.trial_folder(iteration, key)
        record, pruned = self._once(TrialRecord, folder / TRIAL), self.pruned(folder)
        for name, size in record.files.items():
            if name not in pruned:
                records.require_size(folder / name, size)
        amendments = self.amendments(iteration, key)
        if not amendments:
            return record
        last = amendments[-1]
        return record.counting_as(last.outcome, last.reward, last.observation)

    def amendments(self, iteration: int, key: TrialKey) -> tuple[Amendment, ...]:
        """Every outcome that an operator set after accepting a trial; the last one counts."""
        return tuple(records.read(Amendment, path) for path in self._markers(iteration, key, "amended"))

    def changes(self, iteration: int) -> tuple[Change, ...]:
        """The amendments and restorations of an iteration, in time order."""
        changes = [
            Change(_key(match), records.read(kind, entry))
            for entry in entries(self.iteration_folder(iteration))
            if (match := _TRIAL.fullmatch(entry.name)) and (kind := _CHANGES.get(match[3]))
        ]
        return tuple(sorted(changes, key=lambda change: change.note.at))

    def rejections(self) -> tuple[Change, ...]:
        """The attempts that do not count, in order of trials, each with the reason of its last rejection."""
        rejected = sorted(self.existing().rejected, key=lambda key: (key.number, key.attempt))
        changes = []
        for key in rejected:
            marker = self._markers(self.iteration_of(key.number), key, "rejected")[-1]
            changes.append(Change(key, records.read(Note, marker)))
        return tuple(changes)

    def pruned(self, folder: Path) -> dict[str, int]:
        """The recordings removed from a trial's folder to make room, with sizes in bytes. Raises SessionError."""
        path = folder / PRUNED
        return records.read(Pruned, path).files if path.exists() else {}

    def rigs(self) -> Iterator[RigFacts]:
        """The facts of the rig beside each motion, in order. Raises SessionError if one is corrupt."""
        for _, folder in self._iterations():
            for entry in entries(folder):
                if (entry / records.RIG).is_file():
                    yield records.read(RigFacts, entry / records.RIG)

    def trials(self, iteration: int) -> tuple[TrialRecord, ...]:
        """The completed trials of an iteration that count, in order; without control trials, from which nothing is
        learnt.
        """
        return tuple(trial for trial in self.played(iteration) if trial.role is not Role.CONTROL)

    def played(self, iteration: int) -> tuple[TrialRecord, ...]:
        """The completed trials of an iteration that count, in order, control trials too."""
        existing = self.existing(iteration)
        keys = (current_key(existing, number) for number in self.facts.layout.numbers(iteration))
        return tuple(self.trial(iteration, key) for key in keys if key in existing.completed)

    def result(self, iteration: int) -> ResultRecord | None:
        """The newest result of an iteration, or None."""
        folder = self.iteration_folder(iteration)
        count = _results(entries(folder))
        return self._once(ResultRecord, folder / f"result-{count}" / RESULT) if count else None

    def mark_shown(self, iteration: int, at: str) -> None:
        """Note that the operator has seen the newest result of this iteration."""
        folder = self.iteration_folder(iteration)
        path = folder / _shown_mark(_results(entries(folder)))
        if not path.exists():
            durable.write_file(path, records.to_json(Note(at=at, text="shown to the operator")))

    def iterations(self) -> int:
        """How many iterations have begun."""
        return max((number + 1 for number, _ in self._iterations()), default=0)

    def iteration_of(self, number: int) -> int:
        """The iteration that a trial belongs to."""
        return self.facts.layout.iteration_of(number)

    def proposed(self, iteration: int, key: TrialKey) -> MotionRecord | None:
        """The trial as it was proposed before its motion started; None if no motion started. Raises SessionError."""
        path = self._marker(iteration, key, "started")
        return records.read(Started, path).proposed if path.exists() else None

    def mark_started(self, iteration: int, key: TrialKey, at: str, proposed: MotionRecord | None = None) -> None:
        """Note that the arm is about to move. The note is on the disk before this returns."""
        path = self._marker(iteration, key, "started")
        if not path.exists():
            durable.make_folder(path.parent)
            durable.write_file(
                path, records.to_json(Started(at=at, text="the motion was about to start", proposed=proposed))
            )

    def reject(self, iteration: int, key: TrialKey, at: str, reason: str) -> None:
        """Note that this attempt does not count; the next one takes its place."""
        self._mark(iteration, key, "rejected", Note(at=at, text=reason))

    def restore(self, iteration: int, key: TrialKey, at: str, reason: str) -> None:
        """Note that a rejected attempt counts again."""
        self._mark(iteration, key, "restored", Note(at=at, text=reason))

    def amend(self, iteration: int, key: TrialKey, amendment: Amendment) -> None:
        """Note that a completed trial counts with another outcome. Its record is unchanged."""
        self._mark(iteration, key, "amended", amendment)

    def _mark(self, iteration: int, key: TrialKey, kind: str, note: Record) -> None:
        """Write another marker of this kind; earlier ones stay."""
        path = self._nth_marker(iteration, key, kind, len(self._markers(iteration, key, kind)))
        durable.make_folder(path.parent)
        durable.write_file(path, records.to_json(note))

    def _markers(self, iteration: int, key: TrialKey, kind: str) -> list[Path]:
        """The markers of one kind, oldest first."""
        markers: list[Path] = []
        while (path := self._nth_marker(iteration, key, kind, len(markers))).is_file():
            markers.append(path)
        return markers

    def _nth_marker(self, iteration: int, key: TrialKey, kind: str, n: int) -> Path:
        return self._marker(iteration, key, f"{kind}-{n + 1}" if n else kind)

    def save_motion(self, record: MotionRecord, files: Mapping[str, bytes]) -> None:
        """Store a finished motion with its recorded files, whole or not at all."""
        folder = self.trial_folder(*record.position)
        durable.make_folder(folder.parent)
        summed = record.model_copy(update={"checksums": _checksums(files)})
        durable.write_folder(folder, {**files, MOTION: records.to_json(summed)})

    def save_trial(self, record: TrialRecord, derived: Mapping[str, bytes]) -> None:
        """Complete the trial of a stored motion with the files `derived` from its recording."""
        folder = self.trial_folder(*record.position)
        stored_sizes = {entry.name: entry.stat().st_size for entry in entries(folder) if entry.name != MOTION}
        sizes = stored_sizes | {name: len(content) for name, content in derived.items()}
        sized = record.model_copy(update={"files": sizes, "checksums": record.checksums | _checksums(derived)})
        durable.complete_folder(folder, derived, TRIAL, records.to_json(sized))

    def save_result(self, record: ResultRecord, summary: bytes) -> None:
        """Store the result of an iteration; an earlier result that a redo made obsolete stays beside it."""
        folder = self.iteration_folder(record.iteration - 1)
        summed = record.model_copy(update={"summary_sha256": _sha256(summary)})
        files = {SUMMARY: summary, RESULT: records.to_json(summed)}
        durable.write_folder(folder / f"result-{_results(entries(folder)) + 1}", files)

    def overlay(self, picture: bytes) -> Path:
        """Write the picture of the camera's latest finding for the operator. Only a picture in a trial's folder is a
        record.
        """
        path = self.folder / OVERLAY
        durable.replace_file(path, picture)
        return path

    def iteration_folder(self, iteration: int) -> Path:
        """The folder of one iteration, by its index from 0."""
        return self.folder / f"iteration-{iteration + 1:02d}"

    def trial_folder(self, iteration: int, key: TrialKey) -> Path:
        """The folder of one attempt at a trial."""
        return self.iteration_folder(iteration) / f"trial-{key.number:03d}-attempt-{key.attempt + 1}"

    def _once(self, kind: type[AnyRecord], path: Path) -> AnyRecord:
        """A record that never changes. It is read and checked once, so that a session does not get slower."""
        if (record := self._read.get(path)) is None:
            record = self._read[path] = records.read(kind, path)
        assert isinstance(record, kind)
        return record

    def _marker(self, iteration: int, key: TrialKey, kind: str) -> Path:
        folder = self.trial_folder(iteration, key)
        return folder.with_name(f"{folder.name}.{kind}.json")

    def _iterations(self) -> Iterator[tuple[int, Path]]:
        for number, folder in session_parts(self.folder).iterations.items():
            if self._most is None or number < self._most:
                yield number, folder

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock this session against every other process. Raises UsageError if another one holds the lock."""
        refusal = (
            f"session {self.facts.name!r} is being run by another process; stop that one, or name another --session"
        )
        with locked(self.folder, refusal):
            durable.remove_leftovers(self.folder)
            yield


def _key(match: re.Match[str]) -> TrialKey:
    """The trial that a file name refers to."""
    return TrialKey(int(match[1]), int(match[2]) - 1)


def _results(listed: Sequence[Path]) -> int:
    """The number of results among the entries of an iteration's folder."""
    matches = (_RESULT.fullmatch(entry.name) for entry in listed)
    return max((int(match[1]) for match in matches if match), default=0)


def _shown_mark(count: int) -> str:
    return f"result-{count}.shown.json"


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _checksums(files: Mapping[str, bytes]) -> dict[str, str]:
    return {name: _sha256(content) for name, content in files.items()}


def readable(root: Path, name: str) -> AbstractContextManager[SessionStore]:
    """The session `name` of any format, only for reading. One of an earlier format is read from a copy elsewhere.

    Raises SessionError, UsageError.
    """
    migration = import_module("adaptsim_cli.session.earlier")  # on first use: sessions of this format need none of it
    store: AbstractContextManager[SessionStore] = migration.readable(root, name)
    return store
