"""What this computer remembers of one real arm: its stop button's check, set-ups that moved it, its last motion."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from adaptsim_cli.config import Places
from adaptsim_cli.devices.rig_file.description import RigDescription
from adaptsim_cli.storage import durable
from hw.bounded import Unreadable, read_table
from hw.errors import MotionRefused
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
class ArmFacts:
    """The content of the file."""

    stop_button: str = ""  # ISO 8601: when it was last found to stop the arm; "": never
    stop_button_by: str = ""  # the operator
    setups: Mapping[str, str] = field(default_factory=dict)  # `setup_of` -> ISO 8601 of the slow motion with it
    steps: tuple[str, ...] = ()  # those of `adaptsim setup` that are done

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
            found = read_table(self.folder / "known.json")
            known = TypeAdapter(ArmFacts).validate_python(found)
            known.stop_button_is_due(datetime.now(UTC))
        except (FileNotFoundError, Unreadable, TypeError, ValueError):
            return ArmFacts()
        return known if found.keys() == asdict(known).keys() else ArmFacts()

    def stop_button_checked(self, operator: str) -> None:
        """Remember that it stopped the arm just now. Raises SessionError."""
        self._write(replace(self.read(), stop_button=_now(), stop_button_by=operator))

    def moved_slowly(self, setup: str) -> None:
        """Remember that the arm has moved slowly with this set-up. Raises SessionError."""
        known = self.read()
        self._write(replace(known, setups={**known.setups, setup: _now()}))

    def set_up(self, steps: Sequence[str]) -> None:
        """Remember that these steps of a setup are done, and no others. Raises SessionError."""
        self._write(replace(self.read(), steps=tuple(steps)))

    def _write(self, known: ArmFacts) -> None:
        durable.make_folder(self.folder)
        durable.replace_file(self.folder / "known.json", (json.dumps(asdict(known), indent=1) + "\n").encode())

    @contextmanager
    def moving(self) -> Iterator[None]:
        """Around one motion: a file exists from before it until after its end; a stop writes its reason into it.

        Raises DiskFull or SessionError before it begins."""
        durable.make_folder(self.folder)
        began = _now()
        self._note_motion(began, "")
        try:
            yield
        except MotionRefused:
            self._forget()
            raise
        except BaseException as error:
            with suppress(Exception):  # the file exists already, and this must not hide the first error
                self._note_motion(began, str(error) or type(error).__name__)
            raise
        self._forget()

    def unended(self) -> str | None:
        """A sentence about the last motion for a person; None if the motion finished."""
        try:
            said = read_table(self._note)
        except FileNotFoundError:
            return None
        except Unreadable as error:
            return f"The last motion of this arm did not come to its end ({self._note} {error}). {CHECK}"
        why = str(said.get("stopped") or _KILLED)
        return f"The last motion of this arm, begun {said.get('began')}, did not come to its end: {why}. {CHECK}"

    def _note_motion(self, began: str, stopped: str) -> None:
        durable.replace_file(self._note, json.dumps({"began": began, "stopped": stopped}).encode())

    def _forget(self) -> None:
        with suppress(OSError):
            self._note.unlink(missing_ok=True)

    @property
    def _note(self) -> Path:
        return self.folder / "last-motion.json"


def setup_of(rig: RigDescription, cell: Workcell) -> str:
    """A short hash of everything that decides where the arm moves: rig file, tool, table, boxes, calibration."""
    content = repr((rig, cell.tool.name, cell.arm.name, _plain(cell)))
    return hashlib.sha256(content.encode()).hexdigest()[:16]


def _plain(cell: Workcell) -> list[Any]:
    arrays: list[Array] = [cell.arm.zeros_rad, cell.tool.points_F_m, cell.tool.mass.com_m, cell.tool.mass.inertia_kg_m2]
    for capsule in (*cell.tool.capsules, *cell.tool.touching):
        arrays += [capsule.start_m, capsule.end_m, np.array([capsule.radius_m])]
    for box in cell.keep_out:
        arrays += [box.low_m, box.high_m]
    table = cell.table
    return [cell.tool.mass.kg, table.height_m, table.slope_x, table.slope_y, *(array.tolist() for array in arrays)]


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
