"""A folder of recorded trials: CSV or Parquet tables, MCAP files of ROS 2 messages that others wrote (one a trial), or
sessions of this program; and its digest.
"""

from __future__ import annotations

import csv
import hashlib
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptsim_cli.session.recording import DAMAGED
from adaptsim_cli.session.store import FACTS, SessionStore, trials_of
from adaptsim_cli.wiring.recorded.manifest import (
    MANIFEST,
    OUTCOME,
    TIME,
    TRIAL,
    Manifest,
    Mcap,
    RawTrial,
    Tables,
    checked,
    read_manifest,
)
from hw.bounded import Unreadable, read_bytes, require_file
from sim.errors import ExtraMissing, RecordingsRefused
from sim.rollouts.recorded import RecordedTrials, require_enough

if TYPE_CHECKING:
    from sim.tasks.task import Task

TABLE_BYTES, MCAP_BYTES = 512 * 2**20, 8 * 2**30

Columns = dict[str, list[str | float]]

_PART = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)((?:\[\d+\])*)")


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
        return _of_tables(folder, manifest.tables)
    if manifest.mcap is not None:
        return _of_mcap(folder, manifest.mcap)
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


def _of_tables(folder: Path, tables: Tables) -> list[RawTrial]:
    """The trials of the two files. Raises RecordingsRefused, ExtraMissing."""
    rows, samples = read_columns(folder / tables.trials), read_columns(folder / tables.trajectories)
    ours = {theirs: name for name, theirs in tables.columns.items()}
    trial, time = tables.named(TRIAL), tables.named(TIME)
    _require(folder / tables.trials, rows, [trial, *(c for n, c in tables.columns.items() if n != TIME)])
    _require(folder / tables.trajectories, samples, [trial, time, *tables.state])
    which = np.array([str(name) for name in samples[trial]])
    numbers = np.array([_numbers(folder / tables.trajectories, samples, name) for name in (time, *tables.state)]).T
    found, names = [], [str(name) for name in rows[trial]]
    for i, name in enumerate(names):
        mine = numbers[which == name]
        if not len(mine):
            raise RecordingsRefused(f"trial {name} has no sample in {folder / tables.trajectories}")
        values = {ours.get(column, column): cells[i] for column, cells in rows.items()}
        found.append(RawTrial(name, values, mine[:, 0], mine[:, 1:]))
    if strange := sorted(set(which) - set(names)):
        raise RecordingsRefused(
            f"{folder / tables.trajectories} has samples of trial {strange[0]}, which is not listed"
        )
    return found


def read_columns(path: Path) -> Columns:
    """The columns of a table by name. Raises RecordingsRefused, ExtraMissing."""
    try:
        content = read_bytes(path, TABLE_BYTES)
    except FileNotFoundError as error:
        raise RecordingsRefused(f"{path} is missing") from error
    except Unreadable as error:
        raise RecordingsRefused(f"{path} {error}") from error
    if path.suffix == ".parquet":
        return _parquet(path, content)
    try:
        lines = list(csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingsRefused(f"{path} is no CSV table: {error}") from error
    if not lines:
        raise RecordingsRefused(f"{path} is empty: its first line must name the columns")
    head = lines[0]
    if len(set(head)) < len(head):
        raise RecordingsRefused(f"{path} names a column twice: {', '.join(head)}")
    for number, line in enumerate(lines[1:], start=2):
        if len(line) != len(head):
            raise RecordingsRefused(f"{path}, line {number}: {len(line)} cells instead of {len(head)}")
    return {name: [line[i] for line in lines[1:]] for i, name in enumerate(head)}


def _parquet(path: Path, content: bytes) -> Columns:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise ExtraMissing(f"{path} needs the package pyarrow: pip install 'adaptsim[export]'") from error
    try:
        found: Columns = parquet.read_table(io.BytesIO(content)).to_pydict()
    except (pyarrow.ArrowException, OSError) as error:
        raise RecordingsRefused(f"{path} is no Parquet table: {error}") from error
    return found


def _require(path: Path, columns: Columns, wanted: list[str]) -> None:
    if missing := [name for name in wanted if name not in columns]:
        raise RecordingsRefused(f"{path} has no column {missing[0]!r}; its columns are {', '.join(columns)}")


def _numbers(path: Path, columns: Columns, name: str) -> list[float]:
    found = []
    for line, cell in enumerate(columns[name], start=2):
        try:
            found.append(float(cell))
        except (TypeError, ValueError) as error:
            raise RecordingsRefused(f"{path}, line {line}: {name} = {cell!r} is no number") from error
    return found


@dataclass(frozen=True, eq=False)
class _Message:
    topic: str
    content: Any  # decoded
    times_ns: dict[str, int]  # by clock


def _of_mcap(folder: Path, source: Mcap) -> list[RawTrial]:
    """The trials of the files, in the order of their names. Raises RecordingsRefused, ExtraMissing."""
    paths = sorted(folder.glob(source.files))
    if not paths:
        raise RecordingsRefused(f"no file in {folder} is called {source.files}")
    return [_trial(path, source) for path in paths]


def _trial(path: Path, source: Mcap) -> RawTrial:
    asked = {name: _split(path, where) for name, where in source.fields.items()}
    topics = {source.trajectory, *(topic for topic, _ in asked.values()), *([source.start] if source.start else [])}
    first, states = dict[str, _Message](), list[_Message]()
    for message in _messages(path, topics):
        first.setdefault(message.topic, message)
        if message.topic == source.trajectory:
            states.append(message)
    for topic in sorted(topics):
        if topic not in first:
            raise RecordingsRefused(f"{path} has no message of topic {topic}; its topics are {_topics(path)}")
    values = {name: _field(path, first[topic].content, where) for name, (topic, where) in asked.items()}
    begun_ns = _time(path, first[source.start or source.trajectory], source.clock)
    t_s = np.array([1e-9 * (_time(path, one, source.clock) - begun_ns) for one in states]) - source.late_s
    try:
        state = np.array([[float(_field(path, one.content, where)) for where in source.state] for one in states])
    except (TypeError, ValueError) as error:
        raise RecordingsRefused(f"{path}: a state of {source.trajectory} is no number: {error}") from error
    kept = t_s >= 0.0 if source.start else np.ones(len(t_s), dtype=bool)
    return RawTrial(path.stem, values, t_s[kept], state[kept])


def _messages(path: Path, topics: set[str]) -> Iterator[_Message]:
    """The decoded messages of these topics, by their log time."""
    try:
        from mcap_ros2.decoder import DecoderFactory
    except ImportError as error:
        raise ExtraMissing(f"{path} needs the package mcap-ros2-support: pip install 'adaptsim[ros2]'") from error
    from mcap.reader import make_reader

    try:
        require_file(path, MCAP_BYTES)
        with path.open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            for _, channel, raw, content in reader.iter_decoded_messages(topics=sorted(topics)):
                times = {"log": raw.log_time, "publish": raw.publish_time}
                if (header := getattr(content, "header", None)) is not None:
                    times["header"] = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec
                yield _Message(channel.topic, content, times)
    except (*DAMAGED, Unreadable, AttributeError) as error:
        raise RecordingsRefused(f"{path} is no readable MCAP file of ROS 2 messages: {error}") from error


def _topics(path: Path) -> str:
    from mcap.reader import make_reader

    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    found = sorted({channel.topic for channel in summary.channels.values()}) if summary else []
    return ", ".join(found) or "none"


def _time(path: Path, message: _Message, clock: str) -> int:
    if clock not in message.times_ns:
        raise RecordingsRefused(f"{path}: messages of {message.topic} have no header: set clock to log or publish")
    return message.times_ns[clock]


def _split(path: Path, where: str) -> tuple[str, str]:
    topic, colon, field = where.partition(":")
    if not (topic and colon and field):
        raise RecordingsRefused(f"{path.parent}: {where!r} names no field: write topic:field, e.g. /command:data[0]")
    return topic, field


def _field(path: Path, content: Any, where: str) -> float | str:
    """The value at e.g. `pose.position.x` or `data[0]` of a message. Raises RecordingsRefused."""
    value = content
    for part in where.split("."):
        matched = _PART.fullmatch(part)
        try:
            if matched is None:
                raise AttributeError(part)
            value = getattr(value, matched[1])
            for index in re.findall(r"\d+", matched[2]):
                value = value[int(index)]
        except (AttributeError, IndexError, TypeError) as error:
            raise RecordingsRefused(f"{path}: its messages have no field {where!r}") from error
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise RecordingsRefused(f"{path}: the field {where!r} is no number and no text")
    return value
