"""Recorded trials from MCAP files that others wrote, with ROS 2 messages; one file is one trial."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from adaptsim_cli.wiring.recorded.manifest import Mcap, RawTrial
from hw.bounded import Unreadable, require_file
from sim.errors import ExtraMissing, RecordingsRefused

MCAP_BYTES = 8 * 2**30

_PART = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)((?:\[\d+\])*)")


@dataclass(frozen=True, eq=False)
class _Message:
    topic: str
    content: Any  # decoded
    times_ns: dict[str, int]  # by clock


def read_trials(folder: Path, source: Mcap) -> list[RawTrial]:
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
    from mcap.exceptions import McapError
    from mcap.reader import make_reader
    from zstandard import ZstdError

    try:
        require_file(path, MCAP_BYTES)
        with path.open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            for _, channel, raw, content in reader.iter_decoded_messages(topics=sorted(topics)):
                times = {"log": raw.log_time, "publish": raw.publish_time}
                if (header := getattr(content, "header", None)) is not None:
                    times["header"] = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec
                yield _Message(channel.topic, content, times)
    except (
        McapError, ZstdError, Unreadable, OSError, EOFError, ValueError, IndexError, KeyError, AttributeError
    ) as error:  # fmt: skip
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
