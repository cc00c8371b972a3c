"""A completed trial as one MCAP file: pictures, joints, transforms, the arm, its track, its outcome and its events.

A recording is stored before it is tracked and never edited. So this file is made on request, from the recording and the
trial's record.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from adaptsim_cli.session import recording, topics
from adaptsim_cli.session.recording import Recording
from adaptsim_cli.session.records import Facts, TrialRecord
from adaptsim_cli.session.retracking import tool_poses
from adaptsim_cli.session.store import SessionStore

REAL_ARMS = ("panda", "fr3")


@dataclass(frozen=True, eq=False)
class WholeTrial:
    """A completed trial with its recording read."""

    facts: Facts
    record: TrialRecord
    stored: Recording
    file: Path

    @property
    def start_s(self) -> float:
        """Arm clock at the start of the tool's motion."""
        return self.stored.execution.t_start_s

    @property
    def arm(self) -> str:
        """The model of the arm; the simulated lab has a Panda."""
        return self.facts.hw if self.facts.hw in REAL_ARMS else "panda"

    @property
    def title(self) -> str:
        """Title of a file or a viewer's window."""
        return f"{self.facts.name}-trial-{self.record.trial:03d}"

    def events(self) -> Iterator[tuple[float, str, bool]]:
        """(arm clock in s, event, whether it is a warning), in time order."""
        record, start_s = self.record, self.start_s
        yield self.stored.before.t_s, f"the {self.facts.object_name} was detected", False
        yield start_s, "the motion started", False
        for moment in record.moments:
            yield start_s + moment.t_s, f"key moment: {moment.label}", False
        end_s = start_s + record.track.t_s[-1]
        for flag in record.track.flags:
            yield end_s, flag, True
        yield (
            end_s,
            f"outcome: {record.outcome_words}, reward {record.reward:.2f}, expected {record.predicted_reward:.2f}",
            False,
        )
        if record.overruled_from is not None:
            yield end_s, f"the operator set the outcome; tracked: {record.overruled_from.value}", True

    def outcome(self) -> dict[str, object]:
        """The trial's result, by name, in units."""
        shown = {"outcome", "reward", "predicted_reward", "context", "action"}
        return self.record.model_dump(mode="json", include=shown)

    def metadata(self) -> dict[str, str]:
        """The file's metadata for a viewer."""
        facts, record = self.facts, self.record
        units = {d.name: d.unit for space in (facts.context, facts.action, facts.parameters) for d in space if d.unit}
        return {
            "task": facts.task,
            "title": facts.title,
            "session": facts.name,
            "hardware": "recorded trials" if facts.recorded else "simulated lab" if facts.world else facts.hw,
            "world": facts.world,
            "method": facts.method,
            "seed": str(facts.seed),
            "iteration": str(record.iteration),
            "trial": str(record.trial),
            "attempt": str(record.attempt),
            "started": record.started,
            "units": ", ".join(f"{name} in {unit}" for name, unit in units.items()),
            "velocity": "differentiated from the positions",
            "effort": "of the arm's rigid-body model with its hand, without tool and contact",
        }


def open_trial(store: SessionStore, record: TrialRecord) -> WholeTrial:
    """Read a trial. Raises SessionError if its recording is missing, pruned or corrupt."""
    file = store.trial_folder(*record.place) / recording.FILE
    return WholeTrial(store.facts, record, recording.read(file), file)


def encode(trial: WholeTrial) -> bytes:
    """The whole file in memory. Colour images stay bit-identical. Raises SessionError."""
    stored, track = trial.stored, trial.record.track.track()
    played, times_s = stored.execution, [frame.t_s for frame in stored.frames]
    start_ns = round(stored.before.t_s * 1e9)
    messages = [
        *_colours(trial.file),
        *recording.depths(stored),
        *topics.cameras(stored.model, start_ns),
        topics.description(trial.arm, start_ns),
        *topics.joints(played),
        *topics.transforms(times_s, played, tool_poses(trial.file), stored.model, stored.X_BC),
        *recording.track_messages(track, played.t_start_s),
        *(topics.event(t_s, text, is_warning=warns) for t_s, text, warns in trial.events()),
        topics.outcome(played.t_start_s + float(track.t_s[-1]), trial.outcome()),
    ]
    return recording.as_mcap({**recording.TOPICS, **topics.AFTERWARDS}, messages, {}, trial.metadata())


def jpegs(trial: WholeTrial) -> list[tuple[float, bytes]]:
    """(arm clock in s, JPEG) of every image of the motion, as it is stored. Raises SessionError."""
    found = []
    for t_ns, topic, message in _colours(trial.file):
        if topic == recording.COLOURS[0]:
            fields = topics.Reader(message)
            fields.header(), fields.string()
            found.append((1e-9 * t_ns, bytes(fields.blob())))
    return found


def _colours(file: Path) -> list[topics.Message]:
    """The colour images as they are stored."""
    with recording.opened(file) as reader:
        found = reader.iter_messages(topics=list(recording.COLOURS))
        return [(topics.Reader(message.data).header()[0], channel.topic, message.data) for _, channel, message in found]
