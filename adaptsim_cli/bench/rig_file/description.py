"""The content of a rig file, checked at construction. Every key has a help text, and a unit if it has one.

Positions are in the arm's base frame B (X forward, Z up); tool and payload are in the flange frame F.
"""

from __future__ import annotations

from dataclasses import asdict, astuple
from datetime import UTC, date, datetime
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field
from pydantic.dataclasses import dataclass

from adaptsim_cli.bench.rig_file.devices import BalancePart, PedalPart, instrument_parts
from adaptsim_cli.bench.rig_file.keys import RULES, key
from adaptsim_cli.bench.rig_file.waivers import Waivable, WaiverPart
from hw.camera.k4a_device import ColourSettings
from hw.camera.kinds import CAMERAS
from hw.camera.process import CameraProcess, served
from hw.collision import MOST_SLOPE, KeepOut, Side, Table, persons_side
from hw.franka.settings import CollisionThresholds, FrankaSettings, Payload
from hw.franka.starting import (
    HELD_RAD,
    HELD_RANGE_RAD,
    START_RANGE_S,
    START_S,
    UNWATCHED_RANGE_S,
    UNWATCHED_S,
    Starting,
)
from hw.types import Array, frozen_array

Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
Six = tuple[float, float, float, float, float, float]
Seven = tuple[float, float, float, float, float, float, float]
Range = tuple[float, float]
Model = Literal["panda", "fr3", "fr3v2"]

_IMPEDANCE: Seven = tuple(FrankaSettings("arm").joint_impedance_Nm_rad.tolist())
_COLLISION = CollisionThresholds()


@dataclass(frozen=True, config=RULES)
class Collision:
    """Above `contact` the arm reports a contact; above `collision` it stops by itself with a reflex."""

    torque_contact_Nm: Annotated[Seven, key("joint torque that counts as contact", "Nm")] = tuple(
        _COLLISION.torque_contact_Nm.tolist()
    )
    torque_collision_Nm: Annotated[Seven, key("joint torque that stops the arm", "Nm")] = tuple(
        _COLLISION.torque_collision_Nm.tolist()
    )
    force_contact_N: Annotated[Six, key("force along X, Y, Z and moment that count as contact", "N and Nm")] = tuple(
        _COLLISION.force_contact_N.tolist()
    )
    force_collision_N: Annotated[Six, key("force along X, Y, Z and moment that stop the arm", "N and Nm")] = tuple(
        _COLLISION.force_collision_N.tolist()
    )

    def __post_init__(self) -> None:
        self.thresholds()

    def thresholds(self) -> CollisionThresholds:
        """The thresholds of the arm. Raises ValueError if they contradict each other."""
        return CollisionThresholds(*map(np.array, astuple(self)))


@dataclass(frozen=True, config=RULES)
class StartingPart:
    """Limits on the time between the check of a motion and its first command. `adaptsim doctor --measure` proposes
    them.
    """

    unwatched_s: Annotated[
        float, key("longest pause without a state of the arm", "s", ge=UNWATCHED_RANGE_S[0], le=UNWATCHED_RANGE_S[1])
    ] = UNWATCHED_S
    start_s: Annotated[
        float, key("longest time from the check to the first command", "s", ge=START_RANGE_S[0], le=START_RANGE_S[1])
    ] = START_S
    held_rad: Annotated[
        float,
        key("how far a joint that the arm holds may have gone", "rad", ge=HELD_RANGE_RAD[0], le=HELD_RANGE_RAD[1]),
    ] = HELD_RAD


@dataclass(frozen=True, config=RULES)
class ArmPart:
    """The arm. Its hand is set up on the arm's web page (Desk)."""

    model: Annotated[Model, key("panda (Franka Emika Robot), fr3 (Franka Research 3) or fr3v2 (its second version)")]
    address: Annotated[str, key("network address of the arm's control box, without https://")]
    joint_impedance_Nm_rad: Annotated[Seven, key("how stiff the joints are held", "Nm/rad")] = _IMPEDANCE
    collision: Annotated[Collision, key("thresholds at which the arm stops by itself")] = Field(
        default_factory=Collision
    )
    starting: Annotated[StartingPart, key("bounds before the first command of a motion")] = Field(
        default_factory=StartingPart
    )

    def __post_init__(self) -> None:
        self.settings()

    @property
    def stops_at_N(self) -> float:
        """The force along any axis at which the arm stops by itself."""
        return self.collision.thresholds().contact_force_limit_N

    @property
    def stops_at_Nm(self) -> Array:
        """(7,) the torque on each joint at which the arm stops by itself."""
        return self.collision.thresholds().torque_collision_Nm

    def settings(self, payload: Payload | None = None) -> FrankaSettings:
        """The settings of the adapter, with the payload in the hand. Raises ValueError."""
        impedance = np.array(self.joint_impedance_Nm_rad)
        starting = Starting(**asdict(self.starting))
        return FrankaSettings(
            self.address, payload or Payload(), self.collision.thresholds(), impedance, starting=starting
        )


@dataclass(frozen=True, config=RULES)
class PayloadPart:
    """The load in the hand; without it the arm takes the tool's weight for an external force."""

    mass_kg: Annotated[float, key("its mass, without the hand", "kg", ge=0.0, le=3.0)]
    com_F_m: Annotated[Three, key("its centre of mass, in the flange frame", "m")] = (0.0, 0.0, 0.0)
    inertia_F_kg_m2: Annotated[
        tuple[Three, Three, Three], key("its inertia about the centre of mass, three rows", "kg m²")
    ] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def __post_init__(self) -> None:
        self.payload()

    def payload(self) -> Payload:
        """The payload. Raises ValueError for an inertia that no body has."""
        return Payload(self.mass_kg, np.array(self.com_F_m), np.array(self.inertia_F_kg_m2))


@dataclass(frozen=True, config=RULES)
class ToolPart:
    """The tool of one task, and its pose on the flange. Left out: the printed mount that ships with the task."""

    X_FT: Annotated[
        tuple[Four, Four, Four, Four] | None,
        key(
            "pose of the tool in the flange, four rows, for a mount of your own",
            "m",
            examples=[((1.0, 0.0, 0.0, 0.0), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.2), (0.0, 0.0, 0.0, 1.0))],
        ),
    ] = None
    height_m: Annotated[
        float, key("how much higher it sits than in the nominal mount, from the touch-off", "m", ge=-0.02, le=0.02)
    ] = 0.0
    forward_m: Annotated[
        float,
        key("how much further forward it sits than in the nominal mount, from the touch-off", "m", ge=-0.02, le=0.02),
    ] = 0.0
    pitch_rad: Annotated[
        float, key("how much further its edge is pitched down, from the touch-off", "rad", ge=-0.2, le=0.2)
    ] = 0.0
    roll_rad: Annotated[
        float, key("how much further its left side is rolled up, from the touch-off", "rad", ge=-0.2, le=0.2)
    ] = 0.0
    payload: Annotated[PayloadPart | None, key("what the hand holds", examples=[PayloadPart(0.12)])] = None

    def __post_init__(self) -> None:
        if self.X_FT is not None:
            R = np.array(self.X_FT)[:3, :3]
            if np.abs(R @ R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(R) < 0.0 or self.X_FT[3] != (0, 0, 0, 1):
                raise ValueError(
                    "X_FT: not a pose: its upper left 3 × 3 must be a rotation and its last row 0, 0, 0, 1"
                )

    def held(self) -> Payload:
        """The payload; empty if the file does not state it."""
        return Payload() if self.payload is None else self.payload.payload()

    def designed(self, X_FT: Array) -> Array:
        """(4, 4) the tool in the flange before any touch-off: the file's own mount, else `X_FT`."""
        if self.X_FT is None:
            return X_FT
        X = np.array(self.X_FT)
        left, _, right = np.linalg.svd(X[:3, :3])  # the nearest rotation: people round
        X[:3, :3] = left @ right
        return frozen_array(X, (4, 4), "X_FT")


@dataclass(frozen=True, config=RULES)
class TablePart:
    """The table top in the base frame, as a touch-off measures it, and the work area on it."""

    height_m: Annotated[float, key("height under the base's axis", "m", ge=-0.05, le=0.05)] = 0.0
    slope_x: Annotated[float, key("rise per metre along X", ge=-MOST_SLOPE, le=MOST_SLOPE)] = 0.0
    slope_y: Annotated[float, key("rise per metre along Y", ge=-MOST_SLOPE, le=MOST_SLOPE)] = 0.0
    x_m: Annotated[
        Range, key("work area along X, from and to", "m")
    ] = (0.30, 1.20)  # fmt: skip
    y_m: Annotated[
        Range, key("work area along Y, from and to", "m")
    ] = (-0.60, 0.60)  # fmt: skip

    def __post_init__(self) -> None:
        for name, (low, high) in (("x_m", self.x_m), ("y_m", self.y_m)):
            if not low < high:
                raise ValueError(f"{name} = [{low:g}, {high:g}] m: the first must be less than the second")

    def plane(self) -> Table:
        """The table top as a plane in the base frame."""
        return Table(self.height_m, self.slope_x, self.slope_y)

    def covers(self, xy_m: Array) -> bool:
        """Whether all points (..., 2) lie in the work area."""
        low, high = np.array([self.x_m, self.y_m]).T
        return bool(((xy_m >= low) & (xy_m <= high)).all())


@dataclass(frozen=True, config=RULES)
class PersonPart:
    """The operator's side, seen from the base along X: arm and tool stay away from that whole side."""

    side: Annotated[Side, key("left, right, front or back")]
    from_m: Annotated[float, key("where that side begins", "m", ge=0.2, le=1.9)] = 0.6

    def box(self) -> KeepOut:
        """The side that arm and tool must not enter."""
        return persons_side(self.side, self.from_m)


@dataclass(frozen=True, config=RULES)
class KeepOutPart:
    """A box, along the axes of the base frame, that neither arm nor tool enters."""

    name: Annotated[str, key("its name, for messages", min_length=1)]
    low_m: Annotated[Three, key("its lower corner", "m")]
    high_m: Annotated[Three, key("its upper corner", "m")]

    def __post_init__(self) -> None:
        self.box()

    def box(self) -> KeepOut:
        """The keep-out box. Raises ValueError if its corners are swapped."""
        return KeepOut(self.name, np.array(self.low_m), np.array(self.high_m))


def _known_kind(name: str) -> str:
    if name not in CAMERAS:
        raise ValueError(f"it must be one of {', '.join(CAMERAS.names())}")
    return name


@dataclass(frozen=True, config=RULES)
class CameraPart:
    """The camera. Exposure and white balance are fixed, so that pictures are comparable."""

    kind: Annotated[
        str,
        key("kind of camera by its name, such as k4a; `adaptsim setup` lists ours and those of packages"),
        AfterValidator(_known_kind),
    ] = "k4a"
    serial: Annotated[str, key("serial number; empty: the only camera plugged in")] = ""
    exposure_us: Annotated[int, key("exposure of the colour camera", "µs", ge=500, le=33_330)] = 8_000
    white_balance_K: Annotated[int, key("white balance", "K", ge=2_500, le=12_500, multiple_of=10)] = 4_500
    gain: Annotated[int | None, key("gain of the colour camera; left out: unchanged", ge=0, le=255, examples=[128])] = (
        None
    )
    mains_hz: Annotated[Literal[50, 60], key("mains frequency of the lamps, 50 or 60", "Hz")] = 60

    def camera(self, *, infrared: bool = False) -> CameraProcess:
        """The camera, not connected; `infrared` asks for that image in every frame."""
        start = served(CAMERAS.get(self.kind).make)
        return CameraProcess(self.serial or None, self.settings(), infrared=infrared, start=start)

    def settings(self) -> ColourSettings:
        """Exposure, white balance, gain and mains frequency for the camera."""
        return ColourSettings(self.exposure_us, self.white_balance_K, self.gain, self.mains_hz)


@dataclass(frozen=True, config=RULES)
class RigDescription:
    """One lab with one real arm."""

    name: Annotated[str, key("short name of the lab", pattern=r"^[A-Za-z0-9._-]+$")]
    arm: Annotated[ArmPart, key("the arm")]
    table: Annotated[TablePart, key("the table")] = Field(default_factory=TablePart)
    camera: Annotated[CameraPart, key("the camera")] = Field(default_factory=CameraPart)
    pedal: Annotated[PedalPart | None, key("the enabling pedal")] = None
    consent: Annotated[
        Literal["motion", "command"] | None,
        key(
            "what one answer releases: one motion, or all motions that a question announces; left out: one motion",
            examples=["motion"],
        ),
    ] = None
    balance: Annotated[BalancePart | None, key("the balance")] = None
    devices: Annotated[
        dict[str, Any],
        key("instruments whose values are stored with each trial, by the name of their kind"),
        AfterValidator(instrument_parts),
    ] = Field(default_factory=dict, repr=False)
    tools: Annotated[dict[str, ToolPart], key("the tool of each task")] = Field(default_factory=dict)
    person: Annotated[PersonPart | None, key("where the operator stands", examples=[PersonPart("left")])] = None
    keep_out: Annotated[tuple[KeepOutPart, ...], key("boxes that the arm must not enter")] = ()
    waivers: Annotated[
        tuple[WaiverPart, ...], key("safeguards that this lab goes without for 30 days, which every trial records")
    ] = ()

    def __post_init__(self) -> None:
        names = [part.name for part in self.keep_out]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"keep_out: two boxes are called {twice[0]!r}, give each a name of its own")
        waived = [waiver.safeguard for waiver in self.waivers]
        if repeated := sorted({name for name in waived if waived.count(name) > 1}):
            raise ValueError(f"waivers: {repeated[0]} is waived more than once, keep the newest")
        if self.pedal and "pedal" in waived:
            raise ValueError("the file names a pedal and waives it: remove one of the two")
        owners = dict[str, str]()
        for name, part in {"pedal": self.pedal, "balance": self.balance, **self.devices}.items():
            if part is not None and (owner := owners.setdefault(part.port, name)) != name:
                raise ValueError(f"{owner} and {name} share the port {part.port!r}: each needs a port of its own")

    def in_force(self, today: date | None = None) -> tuple[WaiverPart, ...]:
        """The waivers that count today."""
        day = datetime.now(UTC).date() if today is None else today
        return tuple(waiver for waiver in self.waivers if waiver.counts(day))

    def lapsed(self) -> tuple[WaiverPart, ...]:
        """The waivers that do not count today."""
        return tuple(waiver for waiver in self.waivers if waiver not in self.in_force())

    def waives(self, what: Waivable) -> bool:
        """Whether this safeguard is waived today."""
        return any(waiver.safeguard == what for waiver in self.in_force())

    @property
    def is_simulated(self) -> bool:
        """Whether it describes the simulated lab, which has no pedal."""
        return self.arm.address == SIMULATED_ADDRESS

    @property
    def without_hand(self) -> bool:
        """Whether no hand holds the tool."""
        return self.waives("hand")

    def tool(self, task: str) -> ToolPart:
        """The tool of a task; the shipped mount if the file does not name one."""
        return self.tools.get(task, ToolPart())

    def boxes(self) -> tuple[KeepOut, ...]:
        """The keep-out boxes; the one around the camera comes from its calibration."""
        person = () if self.person is None else (self.person.box(),)
        return (*person, *(part.box() for part in self.keep_out))


SIMULATED_ADDRESS = "simulated"
_EVERYWHERE: Range = (-9.0, 9.0)
"""Extent in m, along each axis, of a table without a rig file."""


def as_shipped(model: Model) -> RigDescription:
    """The simulated lab's rig: an arm over a level table with nothing around it, its tools mounted as designed."""
    return RigDescription("simulated", ArmPart(model, SIMULATED_ADDRESS), TablePart(x_m=_EVERYWHERE, y_m=_EVERYWHERE))
