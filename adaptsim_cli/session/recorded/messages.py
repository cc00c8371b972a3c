"""MCAP files of ROS 2 messages that others recorded, with one trial per file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from adaptsim_cli.session.mcap_errors import DAMAGED
from adaptsim_cli.session.recorded.manifest import Mcap, RawTrial
from hw.bounded import Unreadable, require_file
from sim.errors import RecordingsRefused

MCAP_BYTES = 8 * 2**30
_PART = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)((?:\[[0-9]{1,9}\])*)")


def of_mcap(folder: Path, source: Mcap) -> list[RawTrial]:
    """The trials of the files, in the order of their names. Raises RecordingsRefused."""
    try:
        paths = sorted(path for path in folder.glob(source.files) if not path.name.startswith("."))
    except (ValueError, NotImplementedError, OSError) as error:
        raise RecordingsRefused(
            f'{folder}: files = {source.files!r} names no files of this folder: write e.g. "*.mcap" ({error})'
        ) from error
    if not paths:
        raise RecordingsRefused(f"no file in {folder} is called {source.files}")
    return [_trial(path, source) for path in paths]


@dataclass(frozen=True, eq=False)
class _Message:
    topic: str
    content: Any  # decoded
    times_ns: dict[str, int]  # by clock


def _trial(path: Path, source: Mcap) -> RawTrial:
    fields = {name: _split(path, where) for name, where in source.fields.items()}
    topics = {source.trajectory, *(topic for topic, _ in fields.values()), *([source.start] if source.start else [])}
    first, states = dict[str, _Message](), list[_Message]()
    for message in _messages(path, topics):
        first.setdefault(message.topic, message)
        if message.topic == source.trajectory:
            states.append(message)
    for topic in sorted(topics):
        if topic not in first:
            raise RecordingsRefused(f"{path} has no message of topic {topic}; its topics are {_topics(path)}")
    values = {name: _field(path, first[topic].content, where) for name, (topic, where) in fields.items()}
    begun_ns = _time(path, first[source.start or source.trajectory], source.clock)
    t_s = np.array([1e-9 * (_time(path, one, source.clock) - begun_ns) for one in states]) - source.late_s
    try:
        state = np.array([[float(_field(path, one.content, where)) for where in source.state] for one in states])
    except (TypeError, ValueError) as error:
        raise RecordingsRefused(f"{path}: a state of {source.trajectory} is not a number: {error}") from error
    valid = t_s >= 0.0 if source.start else np.ones(len(t_s), dtype=bool)
    return RawTrial(path.stem, values, t_s[valid], state[valid])


def _messages(path: Path, topics: set[str]) -> Iterator[_Message]:
    """The decoded messages of these topics, by their log time; every checksum of the file is verified."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    try:
        require_file(path, MCAP_BYTES)
        with path.open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
            for _, channel, raw, content in reader.iter_decoded_messages(topics=sorted(topics)):
                times = {"log": raw.log_time, "publish": raw.publish_time}
                if (header := getattr(content, "header", None)) is not None:
                    times["header"] = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec
                yield _Message(channel.topic, content, times)
    except GeneratorExit:
        raise
    except (*DAMAGED, Unreadable, AttributeError, TypeError, RecursionError) as error:
        reason = str(error) or f"it ends too early ({type(error).__name__})"
        raise RecordingsRefused(f"{path} is not a readable MCAP file of ROS 2 messages: {reason}") from error
    except Exception as error:  # the parser of message definitions raises plain exceptions
        raise RecordingsRefused(f"{path}: a message definition in it cannot be read: {error}") from error


def _topics(path: Path) -> str:
    from mcap.reader import make_reader

    try:
        with path.open("rb") as file:
            summary = make_reader(file, validate_crcs=True).get_summary()
    except DAMAGED:
        return "unknown: it is damaged"
    names = sorted({channel.topic for channel in summary.channels.values()}) if summary else []
    return ", ".join(names) or "none"


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
            shown = where if len(where) < 80 else f"{where[:60]}…"
            raise RecordingsRefused(f"{path}: its messages have no field {shown!r}") from error
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise RecordingsRefused(f"{path}: the field {where!r} is neither a number nor a text")
    return value
