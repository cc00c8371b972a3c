"""Keeps sessions in order: notes, deletion, and pruning of recordings.

Sealed records never change: a note has its own file, and a pruned recording leaves a record of its absence.
"""

from __future__ import annotations

import json
import platform
import re
import shutil
import zipfile
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from importlib import metadata
from io import BytesIO
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from adaptsim_cli.errors import SessionError, explained
from adaptsim_cli.screen.outputs.exchange import Question
from adaptsim_cli.screen.outputs.sessions import Marked, PrunedRecordings, Verified
from adaptsim_cli.session import records
from adaptsim_cli.session.about import ABOUT, About, about
from adaptsim_cli.session.folders import entries, existing_folder, folder_of, own_files, session_parts, solver_folder
from adaptsim_cli.session.records import Amendment, MotionRecord, Note, Pruned, ResultRecord, Started, TrialRecord
from adaptsim_cli.session.store import MOTION, PRUNED, RESULT, SUMMARY, TRIAL, SessionStore, readable
from adaptsim_cli.storage import durable
from adaptsim_cli.storage.durable import locked
from hw.records import AnyRecord
from sim.storage.files import flush_folder, sha256

T = TypeVar("T")

QUESTION_FILE = ".question.json"

_MARKERS: dict[str, type[Note]] = {".started.": Started, ".amended": Amendment}
"""The kinds of markers beside a trial that hold more than a sentence."""


def verify(root: Path, name: str) -> Verified:
    """Read all of session `name` in `root`. Raises UsageError on an impossible name."""
    folder_of(root, name)
    examination = _Examination()
    try:
        with readable(root, name) as store:
            examination.session(store)
    except SessionError as error:
        return Verified(session=name, files=1, damage=(str(error),), newer_keys=())
    return Verified(
        session=name,
        files=examination.files,
        damage=tuple(message.replace(str(store.folder), str(root / name)) for message in examination.damage),
        newer_keys=tuple(examination.newer_keys),
    )


class _Examination:
    """The files read so far, and the damage found."""

    def __init__(self) -> None:
        self.files = 0
        self.damage: list[str] = []
        self.newer_keys: dict[str, None] = {}  # in order

    def session(self, store: SessionStore) -> None:
        self.files += 2  # session.toml and start.json, read on opening
        self.newer_keys.update(dict.fromkeys(store.additions()))
        if (store.folder / ABOUT).exists():
            self._record(About, store.folder / ABOUT)
        parts = session_parts(store.folder)
        if parts.questions is not None:
            for file in own_files(parts.questions):
                self.files += 1
                if file.name.endswith(QUESTION_FILE):  # an answer may say anything, and a person may correct it
                    self._look(_require_question, file)
        for folder in parts.iterations.values():
            for entry in entries(folder):
                if entry.is_file():
                    self._record(next((kind for name, kind in _MARKERS.items() if name in entry.name), Note), entry)
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
        names = {entry.name for entry in entries(folder)} - {MOTION, TRIAL, RESULT, PRUNED}
        for name in sorted(names | set(checksums)):
            if name in checksums or is_complete:
                self.files += 1
                self._look(self._require_same, folder / name, checksums.get(name))

    def _require_same(self, path: Path, checksum: str | None) -> None:
        if checksum is None:
            raise records.corrupt(path, "it is in no record")
        if _sha256(path) != checksum:
            raise records.corrupt(path, "it was changed after it had been written: its SHA-256 is another")
        from adaptsim_cli.session import recording  # imports OpenCV, and a list of sessions needs none

        recording.require_whole(path)

    def _record(self, kind: type[AnyRecord], path: Path) -> AnyRecord | None:
        self.files += 1
        record = self._look(records.read, kind, path)
        self.newer_keys.update(dict.fromkeys(record.additions if record else ()))
        return record

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


def _require_question(path: Path) -> None:
    try:
        Question.model_validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        why = explained(error) if isinstance(error, ValidationError) else error.strerror
        raise records.corrupt(path, str(why)) from error


def _require_trials(store: SessionStore) -> None:
    """Raises SessionError if a trial of a result is missing."""
    existing = store.existing()
    for iteration, keys in existing.results.items():
        for key in keys:
            if key not in existing.completed:
                raise records.corrupt(store.trial_folder(iteration, key), "it is missing, and a result rests on it")


RECORDED = (".mcap",)
"""Suffixes of the files that `prune` removes; files that a report needs stay."""


def mark(root: Path, name: str, note: str) -> Marked:
    """Replace the note of a session. Raises UsageError, SessionError."""
    folder = existing_folder(root, name)
    with _held(folder):
        content = about(folder).model_copy(update={"note": note.strip()})
        durable.replace_file(folder / ABOUT, records.to_json(content))
    return Marked(session=name, folder=str(folder), note=content.note)


def delete(root: Path, name: str) -> None:
    """Delete a session for good, whole or not at all. Raises UsageError, SessionError."""
    folder = existing_folder(root, name)
    gone = folder.with_name(f".{name}.deleted")
    with _held(folder), durable.explained(folder):
        shutil.rmtree(gone, ignore_errors=True)
        folder.rename(gone)
        flush_folder(root)
    shutil.rmtree(gone, ignore_errors=True)


def prunable(store: SessionStore, *, rejected_only: bool = False) -> PrunedRecordings:
    """The room that `prune` would make. Raises SessionError."""
    recordings = [recorded for _, recorded in _recordings(store, rejected_only=rejected_only)]
    sizes = [path.stat().st_size for recorded in recordings for path in recorded]
    return PrunedRecordings(session=store.facts.name, files=len(sizes), trials=len(recordings), size_bytes=sum(sizes))


def prune(store: SessionStore, *, rejected_only: bool = False) -> PrunedRecordings:
    """Remove the recordings of completed trials and rejected attempts, or of rejected attempts only.

    Records, key moments and reports stay. The removal is recorded first, so that after a crash no recording seems lost.
    Raises SessionError, and UsageError if the session is running.
    """
    with store.locked():
        room = prunable(store, rejected_only=rejected_only)
        at = records.now()
        for folder, recorded in _recordings(store, rejected_only=rejected_only):
            sizes = {path.name: path.stat().st_size for path in recorded}
            durable.replace_file(folder / PRUNED, records.to_json(Pruned(at=at, files=store.pruned(folder) | sizes)))
            for path in recorded:
                with durable.explained(path):
                    path.unlink()
    return room


def _recordings(store: SessionStore, *, rejected_only: bool) -> list[tuple[Path, list[Path]]]:
    """(folder, its recordings) of every trial that does not need its recording to continue."""
    recordings = []
    existing = store.existing()
    for iteration in range(store.iterations()):
        for folder in entries(store.iteration_folder(iteration)):
            if not (folder / MOTION).exists():
                continue
            is_rejected = any(store.trial_folder(iteration, key) == folder for key in existing.rejected)
            if is_rejected or ((folder / TRIAL).exists() and not rejected_only):
                recorded = [path for path in entries(folder) if path.suffix in RECORDED]
                recordings += [(folder, recorded)] if recorded else []
    return recordings


def _held(folder: Path) -> AbstractContextManager[None]:
    return locked(folder, f"session {folder.name!r} is being run by another process; wait until that one ends")


TEXT = (".json", ".toml", ".jsonl")
PICTURES = (".jpg", ".mcap", ".html")
"""Files that show a lab: images, recordings, and pages with images."""


def bundle(
    folder: Path, out: Path, settings: Mapping[str, object], *, pictures: bool = False, force: bool = False
) -> tuple[tuple[str, ...], int]:
    """Write the archive `out` (.zip) of the session in `folder`, damaged or not -> its files, and how many were left
    out because they contain pictures.

    Folder names above the session are left out too, because they may name a person. Raises UsageError if `out` exists
    and not `force`, SessionError, DiskFull.
    """
    durable.require_new(out, force=force)
    chosen, left_out, solver = list[Path](), 0, solver_folder(folder)
    for path in own_files(folder):
        if path.is_relative_to(solver):
            continue
        if path.suffix in TEXT or pictures:
            chosen.append(path)
        elif path.suffix in PICTURES:
            left_out += 1
    about = {
        "session": folder.name,
        "made": records.now(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "packages": dict(sorted(_packages())),
        "settings": settings,
        "left_out_pictures": left_out,
    }
    texts = {"about.json": json.dumps(about, indent=1, default=str)}
    others = dict[str, Path]()
    for path in chosen:
        name = f"{folder.name}/{path.relative_to(folder)}"
        if path.suffix not in TEXT:
            others[name] = path
            continue
        with durable.explained(path):
            texts[name] = path.read_bytes().decode(errors="replace")
    persons, stream = _persons(texts.values()), BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in texts.items():
            archive.writestr(name, _anonymous(text, persons))
        for name, path in others.items():
            with durable.explained(path):
                archive.writestr(name, path.read_bytes())
        names = tuple(archive.namelist())
    durable.make_folder(out.absolute().parent)
    durable.replace_file(out.absolute(), stream.getvalue())
    return names, left_out


_PERSON = re.compile(
    r'"(?:operator|by)"\s*:\s*"((?:[^"\\]|\\.)+)"'  # in a record: who confirmed motions, who waived a safeguard
    r'|"operator: ((?:[^"\\]|\\.)+)"|aived[^"\n]*\(([^()"\n]+), \d{4}-\d\d-\d\d\)'  # the same in a log
)


def _persons(texts: Iterable[str]) -> re.Pattern[str] | None:
    """A pattern that finds the names of all persons; None without a name."""
    names = {name for text in texts for groups in _PERSON.findall(text) for name in groups if name}
    words = "|".join(re.escape(name) for name in sorted(names, key=len, reverse=True))
    return re.compile(rf"(?<!\w)(?:{words})(?!\w)") if names else None


def _anonymous(text: str, persons: re.Pattern[str] | None) -> str:
    """Replace the user's home folder by ~, and leave out the names of persons."""
    text = persons.sub("left out", text) if persons else text
    return text.replace(str(Path.home()), "~") if len(str(Path.home())) > 1 else text


def _packages() -> set[tuple[str, str]]:
    return {(dist.metadata["Name"], dist.version) for dist in metadata.distributions() if dist.metadata["Name"]}
