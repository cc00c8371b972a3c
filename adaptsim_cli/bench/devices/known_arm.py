"""This computer's memory of one real arm: the check of its stop button, the set-ups that moved it, its last motion."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from adaptsim_cli.bench.rig_file.description import RigDescription
from adaptsim_cli.config import Places
from adaptsim_cli.storage import durable
from hw.bounded import Unreadable, read_table
from hw.errors import FingersMoved, HandError, MotionRefused
from hw.types import Array
from hw.workcell import Workcell

STOP_BUTTON_DAYS = 1
"""A check of the stop button counts for so long."""
CHECK = (
    "Check before anything moves: the arm stands still and touches nothing, the hand holds the tool as before, and "
    "object, table and camera have not moved"
)
_KILLED = "the program ended during the motion: it was killed, or the computer was switched off"


def folder_of(places: Places, rig: RigDescription) -> Path:
    """The folder of the notes and the log of the arm of `rig`."""
    return places.data / "arms" / f"{rig.arm.model}-{rig.name}"


@dataclass(frozen=True)
class SetUp:
    """Everything that decides where the arm moves: a short hash for each effect."""

    kind: str = ""  # the task, "board" for a calibration, "touch-off"
    tool: str = ""  # its shape, mass and mount, and the table: what a touch-off finds
    calibration: str = ""  # the camera's pose, and the joint zeros
    rig: str = ""  # the rig file without its waivers, and all boxes


@dataclass(frozen=True)
class SlowMotion:
    """A set-up whose own motion came to its end slowly."""

    setup: SetUp
    at: str  # ISO 8601


@dataclass(frozen=True)
class StopMeasurement:
    """The effect of the stop button on a slow motion, beside the worst case of that motion."""

    at: str  # ISO 8601
    by: str  # the operator
    time_s: float  # from the last command that the arm took until every joint stood
    distance_m: float  # travel of the farthest point of arm and tool until then; inf: not measured
    worst_time_s: float
    worst_distance_m: float  # of the same

    @property
    def is_within(self) -> bool:
        """Whether both lie within the worst case."""
        return self.time_s <= self.worst_time_s and self.distance_m <= self.worst_distance_m

    def __str__(self) -> str:
        verdict = "within" if self.is_within else "BEYOND"
        way = f"{1e3 * self.distance_m:.0f} mm" if isfinite(self.distance_m) else "an unknown way"
        return (
            f"the stop button brought a slow motion to rest in {self.time_s:.2f} s and {way}, "
            f"{verdict} the worst case of {self.worst_time_s:.2f} s and {1e3 * self.worst_distance_m:.0f} mm "
            f"({self.at[:10]}, {self.by})"
        )


@dataclass(frozen=True)
class ArmFacts:
    """The content of the file."""

    stop_button: str = ""  # ISO 8601: when it was last found to stop the arm; "": never
    stop_button_by: str = ""  # the operator
    slow_motions: tuple[SlowMotion, ...] = ()
    stop: StopMeasurement | None = None  # None: never measured
    steps: tuple[str, ...] = ()  # those of `adaptsim setup` that are done

    def slow_motion(self, setup: SetUp) -> str:
        """When the task's motion was completed slowly with this set-up (ISO 8601); "" if it never was."""
        return next((motion.at for motion in self.slow_motions if motion.setup == setup), "")

    def new_in(self, setup: SetUp) -> str:
        """The parts of a set-up that have never moved slowly, as the beginning of a sentence."""
        like = [motion.setup for motion in self.slow_motions if motion.setup.kind == setup.kind]
        parts = (
            ("tool or table", setup.tool, {one.tool for one in like}),
            ("calibration", setup.calibration, {one.calibration for one in like}),
            ("rig file", setup.rig, {one.rig for one in like}),
        )
        changed = [name for name, value, earlier in parts if value not in earlier] if like else []
        if changed:
            return f"The {' and the '.join(changed)} changed after {setup.kind} last moved slowly, and this set-up has"
        return f"With this rig file, tool and calibration {setup.kind or 'this task'} has"

    def stop_button_is_due(self, now: datetime) -> bool:
        """Whether the stop button has to be checked (again)."""
        if not self.stop_button:
            return True
        return not timedelta(0) <= now - datetime.fromisoformat(self.stop_button) <= timedelta(days=STOP_BUTTON_DAYS)


@dataclass(frozen=True)
class KnownArm:
    """The files of an arm. A damaged `known.json` counts as empty: everything is then asked again."""

    folder: Path

    def read(self) -> ArmFacts:
        """The content; empty without a file."""
        try:
            table = read_table(self.folder / "known.json")
            facts = TypeAdapter(ArmFacts).validate_python(table)
            facts.stop_button_is_due(datetime.now(UTC))
        except (FileNotFoundError, Unreadable, TypeError, ValueError):
            return ArmFacts()
        return facts if {*table, "stop"} == asdict(facts).keys() else ArmFacts()  # older files have no stop

    def stop_button_checked(self, operator: str) -> None:
        """Remember that it stopped the arm just now. Raises SessionError."""
        self._write(replace(self.read(), stop_button=_now(), stop_button_by=operator))

    def stop_measured(self, measurement: StopMeasurement) -> None:
        """Remember how the stop button stopped a slow motion. Raises SessionError."""
        self._write(replace(self.read(), stop=measurement))

    def moved_slowly(self, setup: SetUp) -> None:
        """Remember that the own motion of this set-up came to its end slowly. Raises SessionError."""
        facts = self.read()
        others = tuple(motion for motion in facts.slow_motions if motion.setup != setup)
        self._write(replace(facts, slow_motions=(*others, SlowMotion(setup, _now()))))

    def set_up(self, steps: Sequence[str]) -> None:
        """Remember that these steps of a setup are done, and no others. Raises SessionError."""
        self._write(replace(self.read(), steps=tuple(steps)))

    def _write(self, facts: ArmFacts) -> None:
        durable.make_folder(self.folder)
        durable.replace_file(self.folder / "known.json", (json.dumps(asdict(facts), indent=1) + "\n").encode())

    @contextmanager
    def moving(self) -> Iterator[None]:
        """A context manager around one motion. A file exists from before the motion until after its end, and a stop
        writes its reason there.

        A motion of the hand has ended when its fingers stand still, even if it did not obey the command.

        Raises DiskFull or SessionError before it begins.
        """
        durable.make_folder(self.folder)
        began = _now()
        self._note_motion(began, "")
        try:
            yield
        except BaseException as error:
            if isinstance(error, MotionRefused | HandError) and not isinstance(error, FingersMoved):
                self._forget()
                raise
            with suppress(Exception):  # the file exists already, and this must not hide the first error
                self._note_motion(began, str(error) or type(error).__name__)
            raise
        self._forget()

    def unended(self) -> str | None:
        """A sentence about the last motion for a person; None if the motion finished."""
        try:
            note = read_table(self._note)
        except FileNotFoundError:
            return None
        except Unreadable as error:
            return f"The last motion of this arm did not come to its end ({self._note} {error}). {CHECK}"
        why = str(note.get("stopped") or _KILLED)
        return f"The last motion of this arm, begun {note.get('began')}, did not come to its end: {why}. {CHECK}"

    def _note_motion(self, began: str, stopped: str) -> None:
        durable.replace_file(self._note, json.dumps({"began": began, "stopped": stopped}).encode())

    def _forget(self) -> None:
        with suppress(OSError):
            self._note.unlink(missing_ok=True)

    @property
    def _note(self) -> Path:
        return self.folder / "last-motion.json"


def setup_of(rig: RigDescription, cell: Workcell, kind: str, X_BC: Array | None = None) -> SetUp:
    """The set-up of a rig whose arm does `kind` in this workcell, with the camera at X_BC (4, 4) if that matters."""
    tool, table = cell.tool, cell.table
    arrays: list[Array] = [tool.points_F_m, tool.mass.com_m, tool.mass.inertia_kg_m2]
    for capsule in tool.capsules:
        arrays += [capsule.start_m, capsule.end_m, np.array([capsule.radius_m])]
    boxes = [(box.name, box.low_m.tolist(), box.high_m.tolist()) for box in cell.keep_out]
    return SetUp(
        kind,
        _hash(tool.name, tool.mass.kg, table.height_m, table.slope_x, table.slope_y, *map(np.ndarray.tolist, arrays)),
        _hash(cell.arm.zeros_rad.tolist(), None if X_BC is None else X_BC.tolist()),
        _hash(replace(rig, waivers=()), cell.arm.name, boxes),
    )


def _hash(*content: Any) -> str:
    return hashlib.sha256(repr(content).encode()).hexdigest()[:16]


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
