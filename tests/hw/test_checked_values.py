"""No value that decides about a motion can be made of numbers that are not finite or out of range."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cells import cell, find, stick

from hw.capsules import Capsule
from hw.collision import KeepOut, Table, Tool
from hw.errors import MotionRefused
from hw.franka.settings import CollisionThresholds, FrankaSettings, Payload
from hw.limits import CONTACT_FORCE_N
from hw.mass import HEAVIEST_KG, Mass
from hw.motion_limits import RATED_NM
from hw.types import ArmState, ContactWindow, Execution, HandState, JointPath

NOT_FINITE = (math.nan, math.inf, -math.inf, 1e308, -1e308)
NEGATIVE = (-1e-9, -1.0)
Make = Callable[[Any], object]
THREE, SEVEN = np.zeros(3), np.zeros(7)


def at(shape: int, value: float) -> np.ndarray:
    array = np.full(shape, 0.1)
    array[shape // 2] = value
    return array


NUMBERS: dict[str, tuple[Make, tuple[float, ...]]] = {
    "window: start": (lambda v: ContactWindow(v, 1.0, 0.001, 5.0), NEGATIVE),
    "window: end": (lambda v: ContactWindow(0.5, v, 0.001, 5.0), (*NEGATIVE, 0.4)),
    "window: depth": (lambda v: ContactWindow(0.0, 1.0, v, 5.0), NEGATIVE),
    "window: force": (lambda v: ContactWindow(0.0, 1.0, 0.001, v), NEGATIVE),
    "path: joints": (lambda v: JointPath(np.array([0.0, 1e-3]), np.tile(at(7, v), (2, 1))), (7.0,)),
    "path: times": (lambda v: JointPath(np.array([0.0, v]), np.zeros((2, 7))), (*NEGATIVE, 0.0, 0.002)),
    "capsule: radius": (lambda v: Capsule("rod", 8, THREE, THREE, v), NEGATIVE),
    "capsule: end": (lambda v: Capsule("rod", 8, THREE, at(3, v), 0.1), (11.0,)),
    "capsule: link": (lambda v: Capsule("rod", v, THREE, THREE, 0.1), (-1.0, 9.0)),
    "box: low": (lambda v: KeepOut("box", at(3, v), np.ones(3)), (1.0, 2.0)),
    "box: high": (lambda v: KeepOut("box", THREE, at(3, v)), (0.0, -1.0, 11.0)),
    "table: height": (Table, (11.0,)),
    "table: slope": (lambda v: Table(0.0, v), (0.2, -0.2)),
    "tool: points": (lambda v: Tool("tool", Mass(0.1, THREE, np.zeros((3, 3))), (), at(3, v)[None]), (11.0,)),
    "mass: kg": (lambda v: Mass(v, THREE, np.zeros((3, 3))), (*NEGATIVE, HEAVIEST_KG + 1.0)),
    "mass: centre": (lambda v: Mass(1.0, at(3, v), np.zeros((3, 3))), (11.0,)),
    "mass: inertia": (lambda v: Mass(1.0, THREE, np.diag(at(3, v))), NEGATIVE),
    "payload: mass": (Payload, (*NEGATIVE, 3.1)),
    "payload: centre": (lambda v: Payload(0.1, at(3, v)), (1.5,)),
    "payload: inertia": (lambda v: Payload(0.1, THREE, np.diag(at(3, v))), NEGATIVE),
    "thresholds: torque": (lambda v: CollisionThresholds(torque_collision_Nm=at(7, v) + 20.0), (RATED_NM[3],)),
    "settings: impedance": (lambda v: FrankaSettings("arm", joint_impedance_Nm_rad=at(7, v)), (*NEGATIVE, 0.0)),
    "cell: force": (lambda v: cell(stops_at_N=v), (*NEGATIVE, 0.0)),
    "cell: torque": (lambda v: cell(stops_at_Nm=at(7, v)), (*NEGATIVE, 0.0)),
    "cell: joint zeros": (lambda v: cell(zeros_rad=at(7, v)), (0.2,)),
    "state: joints": (lambda v: ArmState(0.0, at(7, v), SEVEN), ()),
    "state: speeds": (lambda v: ArmState(0.0, SEVEN, at(7, v)), ()),
    "execution: rate": (lambda v: Execution(0.0, np.zeros(0), np.zeros((0, 7)), np.zeros((0, 7)), v), (-0.1, 1.1)),
    "execution: joints": (lambda v: Execution(0.0, np.zeros(1), np.zeros((1, 7)), at(7, v)[None], 1.0), ()),
    "hand: width": (lambda v: HandState(v, True, True), (*NEGATIVE, 0.2)),
}
NO_SIZE = {"state: joints", "state: speeds", "execution: joints"}
"""A device may report any finite number here: it is shown, and nothing is planned with it."""


@pytest.mark.parametrize("name", NUMBERS)
def test_no_hostile_number_becomes_a_value(name: str) -> None:
    make, out_of_range = NUMBERS[name]
    hostile = [v for v in NOT_FINITE if not (name in NO_SIZE and math.isfinite(v))]
    for value in (*hostile, *out_of_range):
        with pytest.raises(ValueError, match=r"\w"):
            make(value)


@pytest.mark.parametrize("text", ["0.001", "nan", None])
def test_a_text_is_no_number(text: Any) -> None:
    with pytest.raises(ValueError, match="depth"):
        ContactWindow(0.0, 1.0, text, 5.0)


def test_a_window_of_any_depth_keeps_the_check_of_the_table() -> None:
    """The tool is led 74 mm below the table: no window that can be made allows it."""
    q_rad = np.array([0.0, 0.35, 0.0, -2.1, 0.0, 2.45, np.pi / 4])
    path = JointPath(np.arange(100) / 1e3, np.tile(q_rad, (100, 1)))
    within = cell("fr3", stick((0.0, 0.0, 0.325)))
    deep = find(path, "depth in the table", within)
    assert deep.ratio > 1.0
    tried = 0
    for depth_m in (-1.0, -1e-9, 0.0, 0.003, 0.006, deep.value, 1.0, math.nan):
        try:
            window = ContactWindow(0.0, 0.099, depth_m, 5.0)
        except ValueError:
            continue
        tried += 1
        with pytest.raises(MotionRefused):
            within.require(replace(path, contact=window))
    assert tried == 5


def test_the_defaults_let_every_contact_through_that_the_limits_allow() -> None:
    settings = FrankaSettings("172.16.0.2")
    assert settings.collision.contact_force_limit_N > CONTACT_FORCE_N
    assert settings.payload.mass_kg == 0.0


@pytest.mark.parametrize("host", ["", " ", "https://172.16.0.2", "172.16.0.2:1337", "my arm"])
def test_an_address_is_a_name_or_number_alone(host: str) -> None:
    with pytest.raises(ValueError, match="address"):
        FrankaSettings(host)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Payload(0.1, np.zeros(2)), "centre of mass"),
        (lambda: Payload(0.1, np.zeros(3), np.triu(np.ones((3, 3)))), "symmetric and not negative"),
        (lambda: CollisionThresholds(torque_contact_Nm=np.full(7, 10.5)), "contact .* is above collision"),
        (lambda: CollisionThresholds(torque_collision_Nm=np.full(7, 36.0)), "value 5 is 36, its limit 10.8"),
        (lambda: CollisionThresholds(force_collision_N=np.full(6, 500.0)), "at most 100"),
        (lambda: CollisionThresholds(torque_collision_Nm=np.full(6, 50.0)), "shape"),
    ],
)
def test_what_cannot_be_is_refused_when_it_is_said(make: object, words: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=words):
        make()
