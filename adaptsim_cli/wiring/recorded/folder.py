"""A folder of recorded trials: reads it by its manifest, or as a session, and gives its digest."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from adaptsim_cli.session.store import FACTS, SessionStore, trials_of
from adaptsim_cli.wiring.recorded import mcap, tables
from adaptsim_cli.wiring.recorded.manifest import MANIFEST, OUTCOME, Manifest, RawTrial, checked, read_manifest
from sim.errors import RecordingsRefused
from sim.rollouts.recorded import RecordedTrials, require_enough

if TYPE_CHECKING:
    from sim.tasks.task import Task


def read_recorded(task: Task, folder: Path) -> RecordedTrials:
    """The recorded trials in a folder: with `recorded.toml`, or a session of this program.

    Raises RecordingsRefused with the reason, SessionError for a damaged session, ExtraMissing.
    """
    if not folder.is_dir():
        raise RecordingsRefused(f"--recorded {folder}: there is no such folder")
    if (folder / FACTS).exists():
        return require_enough(checked(task, _of_session(task, folder), None))
    manifest = read_manifest(folder / MANIFEST)
    if manifest.task != task.name:
        raise RecordingsRefused(f"{folder / MANIFEST} is of task {manifest.task}, not of {task.name}")
    return require_enough(checked(task, _raw(task, folder, manifest), manifest.outcome))


def digest(trials: RecordedTrials) -> str:
    """SHA-256 of everything that a session can see of the trials."""
    total = hashlib.sha256(repr((trials.names, [t.outcome for t in trials.tracks])).encode())
    contexts = () if trials.contexts is None else (trials.contexts,)
    for array in (trials.actions, *contexts, *(part for t in trials.tracks for part in (t.t_s, t.state))):
        total.update(np.ascontiguousarray(array).tobytes())
    return total.hexdigest()


def _raw(task: Task, folder: Path, manifest: Manifest) -> list[RawTrial]:
    if manifest.tables is not None:
        return tables.read_trials(folder, manifest.tables)
    if manifest.mcap is not None:
        return mcap.read_trials(folder, manifest.mcap)
    found = []
    for name in manifest.sessions:
        where = folder / name
        if not (where / FACTS).exists():
            raise RecordingsRefused(f"{folder / MANIFEST}: {where} is no session")
        found += _of_session(task, where)
    return found


def _of_session(task: Task, folder: Path) -> list[RawTrial]:
    """Every trial that counts, of repeated actions the first. Raises RecordingsRefused for another task."""
    store = SessionStore.open(folder.parent, folder.name)
    if store.facts.task != task.name:
        raise RecordingsRefused(f"{folder} is a session of {store.facts.task}, not of {task.name}")
    raw, seen = list[RawTrial](), set[tuple[float, ...]]()
    for trial in trials_of(store):
        if (action := tuple(trial.action.values())) in seen:
            continue
        seen.add(action)
        track = trial.track.track()
        values: dict[str, float | str] = {**trial.context, **trial.action, OUTCOME: trial.outcome.value}
        name = f"{store.facts.name}/{trial.trial}"
        raw.append(RawTrial(name, values, track.t_s, track.state, track.end_in_tool_m))
    return raw
