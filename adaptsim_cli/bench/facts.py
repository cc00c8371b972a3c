"""The stored facts of a rig beside a trial."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from hw.records import Record


class WaiverRecord(Record):
    """A safeguard that the lab went without."""

    safeguard: str  # e.g. "pedal"
    reason: str  # as typed
    by: str  # who decided it
    on: str  # ISO 8601, a day
    until: str  # ISO 8601, the last day on which it counts


class RigFacts(Record):
    """rig.json beside a trial on a real rig: the object's mass, and the state of pedal, tool and camera."""

    object_mass_kg: float | None = None
    weighed: str | None = None  # ISO 8601
    pedal: Literal["held", "waived"] | None = None  # "waived": the rig file waives it
    tool: Literal["held", "waived"] | None = None  # checked by the hand before every motion; "waived": by the rig file
    tool_width_m: float | None = None  # between the fingers that hold it, at the command's first check
    brightness: float | None = None  # median grey value of the picture before the motion, 0 to 255
    camera: dict[str, Any] | None = None  # serial, exposure, white balance, lost frames
    instruments: dict[str, float] = Field(default_factory=dict)  # `instrument.quantity`, with its unit -> value
    problem: str = ""  # why the other values are missing
    operator: str = ""  # who typed the arm's model
    consent: str | None = None  # ISO 8601: when it was typed
    stop_button: str = ""  # ISO 8601: when the arm's stop button was last found to stop it; "": never, or waived
    waivers: tuple[WaiverRecord, ...] = ()  # safeguards that the rig file waives
    pace: float = 1.0  # of every motion
