"""A folder of recorded trials: CSV or Parquet tables, MCAP files of ROS 2 messages that others wrote (one per trial),
or sessions of this program; and its digest.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from adaptsim_cli.session.folders import FACTS
from adaptsim_cli.session.history import trials_of
from adaptsim_cli.session.recorded.datasets import of_lerobot, of_robomimic
from adaptsim_cli.session.recorded.manifest import (
    MANIFEST,
    OUTCOME,
    TIME,
    TRIAL,
    Manifest,
    RawTrial,
    Tables,
    checked,
    read_manifest,
)
from adaptsim_cli.session.recorded.messages import of_mcap
from adaptsim_cli.session.recorded.tables import numbers, read_columns, require_columns
from adaptsim_cli.session.store import readable
from sim.errors import RecordingsRefused
from sim.rollouts.recorded import RecordedTrials, require_sound

if TYPE_CHECKING:
    from sim.tasks.task import Task


def read_recorded(task: Task, folder: Path) -> RecordedTrials:
    """The recorded trials in a folder: with `recorded.toml`, or a session of this program.

    Raises RecordingsRefused with the reason, SessionError for a damaged session, ExtraMissing.
    """
    if "\0" in str(folder) or not folder.is_dir():
        raise RecordingsRefused(f"--recorded {str(folder)!r}: there is no such folder")
    if (folder / FACTS).exists():
        return require_sound(checked(task, _of_session(task, folder), None))
    manifest = read_manifest(folder / MANIFEST)
    if manifest.task != task.name:
        raise RecordingsRefused(f"{folder / MANIFEST} is of task {manifest.task}, not of {task.name}")
    raw, notes = _raw(task, folder, manifest)
    return require_sound(checked(task, raw, manifest.outcome, notes, as_written=manifest.as_written))


def digest(trials: RecordedTrials) -> str:
    """SHA-256 of everything that a session can see of the trials."""
    total = hashlib.sha256(repr((trials.names, [t.outcome for t in trials.tracks])).encode())
    contexts = () if trials.contexts is None else (trials.contexts,)
    for array in (trials.actions, *contexts, *(part for t in trials.tracks for part in (t.t_s, t.state))):
        total.update(np.ascontiguousarray(array).tobytes())
    return total.hexdigest()


def _raw(task: Task, folder: Path, manifest: Manifest) -> tuple[list[RawTrial], tuple[str, ...]]:
    """The trials of the one source, and sentences about their reading."""
    if manifest.tables is not None:
        return _of_tables(folder, manifest.tables)
    if manifest.mcap is not None:
        return of_mcap(folder, manifest.mcap), ()
    if manifest.lerobot is not None:
        return of_lerobot(folder, manifest.lerobot), ()
    if manifest.robomimic is not None:
        return of_robomimic(folder, manifest.robomimic), ()
    trials = []
    for name in manifest.sessions:
        where = folder / name
        if "\0" in name or not (where / FACTS).exists():
            raise RecordingsRefused(f"{folder / MANIFEST}: {where} is not a session")
        trials += _of_session(task, where)
    return trials, ()


def _of_session(task: Task, folder: Path) -> list[RawTrial]:
    """Every trial that counts; of repeated actions, only the first. Raises RecordingsRefused for another task."""
    with readable(folder.parent, folder.name) as store:
        facts, trials = store.facts, trials_of(store)
    if facts.task != task.name:
        raise RecordingsRefused(f"{folder} is a session of {facts.task}, not of {task.name}")
    raw, actions = list[RawTrial](), set[tuple[float, ...]]()
    for trial in trials:
        if (action := tuple(trial.action.values())) in actions:
            continue
        actions.add(action)
        track = trial.track.track()
        values: dict[str, float | str] = {**trial.context, **trial.action, OUTCOME: trial.outcome.value}
        name = f"{facts.name}/{trial.trial}"
        raw.append(RawTrial(name, values, track.t_s, track.state, track.end_in_tool_m))
    return raw


def _of_tables(folder: Path, tables: Tables) -> tuple[list[RawTrial], tuple[str, ...]]:
    """The trials of the two files, and sentences about unused columns. Raises RecordingsRefused, ExtraMissing."""
    listed, sampled = folder / tables.trials, folder / tables.trajectories
    trial, time = tables.named(TRIAL), tables.named(TIME)
    rows, samples = read_columns(listed), read_columns(sampled, list(dict.fromkeys([trial, time, *tables.state])))
    ours = tables.our_names(rows)
    require_columns(listed, list(rows), [trial, *(c for n, c in tables.columns.items() if n != TIME)])
    require_columns(sampled, list(samples), [trial, time, *tables.state])
    values = np.array([numbers(sampled, samples, name) for name in (time, *tables.state)]).T
    which, inverse = np.unique(np.array([str(name) for name in samples[trial]], dtype=str), return_inverse=True)
    order = np.argsort(inverse, kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(inverse, minlength=len(which)))[:-1]) if len(which) else []
    by_trial = dict(zip(which.tolist(), parts, strict=True))
    trials, names = [], [str(name) for name in rows[trial]]
    for i, name in enumerate(names):
        if name not in by_trial:
            raise RecordingsRefused(f"trial {name} has no sample in {sampled}")
        mine = values[by_trial[name]]
        cells = {name: rows[column][i] for column, name in ours.items()}
        trials.append(RawTrial(name, cells, mine[:, 0], mine[:, 1:]))
    if strange := sorted(set(by_trial) - set(names)):
        raise RecordingsRefused(f"{sampled} has samples of trial {strange[0]}, which is not listed")
    return trials, tables.unused(tables.trials, rows)
