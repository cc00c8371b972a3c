"""Both models over the interface of their SDKs: settings into calls, exceptions into words, cycles in order."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from sdk_fake import Q_RAD, FakeSdk, FrankaException, NetworkException

from hw.franka.connection import DRIVES, Connection
from hw.franka.driver import FAULT, LOST, UNAVAILABLE, Failure
from hw.franka.settings import CollisionThresholds, FrankaSettings, Payload

SETTINGS = FrankaSettings(
    "172.16.0.2",
    Payload(0.35, np.array([0.01, 0.0, 0.08]), np.array([[2.0, 0.1, 0.2], [0.1, 3.0, 0.3], [0.2, 0.3, 4.0]]) * 1e-3),
    CollisionThresholds(torque_collision_Nm=np.array([50.0] * 4 + [10.0] * 3)),
    np.full(7, 2500.0),
)
MODELS = ["panda", "fr3", "fr3v2"]


def connected(model: str, sdk: FakeSdk | None = None, *, realtime: bool = True) -> tuple[Connection, FakeSdk]:
    sdk = sdk or FakeSdk(k=model == "panda")
    return Connection(model, sdk, DRIVES[model], SETTINGS, realtime=realtime, clock=sdk.clock), sdk


@pytest.mark.parametrize("model", MODELS)
def test_settings_become_calls(model: str) -> None:
    driver, sdk = connected(model)
    assert sdk.calls == [("Robot", ("172.16.0.2", "kEnforce"))], "connecting sets nothing"
    driver.prepare(driver.reading().at_s)
    calls = dict(sdk.calls)
    torque_contact, torque_collision, force_contact, force_collision = calls["set_collision_behavior"]
    assert torque_contact == [20.0, 20.0, 18.0, 18.0, 8.0, 8.0, 8.0]
    assert torque_collision == [50.0] * 4 + [10.0] * 3
    assert (force_contact[0], force_collision[0]) == (20.0, 80.0)
    assert calls["set_joint_impedance"] == [2500.0] * 7
    mass, com, inertia = calls["set_load"]
    assert (mass, com) == (0.35, [0.01, 0.0, 0.08])
    assert inertia == pytest.approx([2e-3, 1e-4, 2e-4, 1e-4, 3e-3, 3e-4, 2e-4, 3e-4, 4e-3])


@pytest.mark.parametrize("model", MODELS)
def test_real_time_is_relaxed_only_when_told(model: str) -> None:
    _, sdk = connected(model, realtime=False)
    assert dict(sdk.calls)["Robot"] == ("172.16.0.2", "kIgnore")


@pytest.mark.parametrize("model", MODELS)
def test_a_motion_is_driven_until_its_last_joints(model: str) -> None:
    driver, sdk = connected(model, FakeSdk(k=model == "panda", lost_cycles=(3,)))
    seen: list[float] = []
    way_rad = [[q + 1e-9 * i for q in Q_RAD] for i in range(5)]
    steps: Iterator[tuple[list[float], bool]] = iter([(q, i == 4) for i, q in enumerate(way_rad)])

    def step(state: Any, dt_s: float) -> tuple[list[float], bool]:
        seen.append(dt_s)
        return next(steps)

    driver.drive(step)
    assert seen == [0.0, 0.001, 0.002, 0.001, 0.001]
    commands = [what for name, what in sdk.calls if name == "command"]
    assert [q for q, _ in commands] == way_rad
    assert [finished for _, finished in commands] == [False] * 4 + [True]


def test_the_panda_plays_the_path_unfiltered_and_unlimited_under_joint_impedance() -> None:
    driver, sdk = connected("panda")
    driver.drive(lambda state, dt_s: (list(Q_RAD), True))
    assert dict(sdk.calls)["control_joint_position"] == {
        "controller_mode": "kJointImpedance",
        "limit_rate": False,
        "cutoff_frequency": 1000.0,
    }


@pytest.mark.parametrize("model", MODELS)
def test_modes_are_named_alike(model: str) -> None:
    driver, sdk = connected(model)
    assert driver.reading().mode == "Idle"
    sdk.modes.reasons = ("joint_reflex",)
    assert driver.reading().mode == "Reflex"
    assert driver.reading().reasons == ("joint_reflex",)


@pytest.mark.parametrize("model", MODELS)
def test_recovery_is_asked_for_only_after_a_reflex(model: str) -> None:
    driver, sdk = connected(model)
    driver.recover()
    assert "automatic_error_recovery" not in dict(sdk.calls)
    sdk.modes.be("Reflex")
    driver.recover()
    assert "automatic_error_recovery" in dict(sdk.calls)
    assert driver.reading().mode == "Idle"


@pytest.mark.parametrize(
    ("model", "error", "kind", "words"),
    [
        ("fr3", NetworkException("libfranka: Connection timeout."), LOST, "fr3 at 172.16.0.2 does not answer"),
        ("panda", RuntimeError("libfranka: Connection error: no route"), LOST, "panda at 172.16.0.2 does not answer"),
        (
            "panda",
            RuntimeError("libfranka: Incompatible library version (server version: 10, library version: 5). Please"),
            UNAVAILABLE,
            "this arm is of the model fr3",
        ),
        (
            "fr3",
            FrankaException("libfranka: Incompatible library version (server version: 9, library version: 10)."),
            UNAVAILABLE,
            "5.7.2 up to 5.9.0 (FR3), libfranka 0.15.0 up to 0.18.0); update the arm to system 5.9.0",
        ),
        (
            "panda",
            RuntimeError("libfranka: Running kernel does not have realtime capabilities."),
            UNAVAILABLE,
            "docs/guide/arms.md",
        ),
        ("fr3", RuntimeError("libfranka: Set Load command rejected"), FAULT, "the arm says: Set Load command rejected"),
    ],
)
def test_an_exception_while_connecting_is_put_in_words(model: str, error: Exception, kind: str, words: str) -> None:
    with pytest.raises(Failure) as raised:
        connected(model, FakeSdk(k=model == "panda", fails={"Robot": error}))
    assert raised.value.kind == kind
    assert words in raised.value.text


@pytest.mark.parametrize("model", MODELS)
def test_a_reflex_during_a_motion_names_its_reasons(model: str) -> None:
    driver, sdk = connected(model)

    def late(cycle: int) -> None:
        sdk.modes.reasons = ("communication_constraints_violation",)

    sdk.when = late
    with pytest.raises(Failure, match=r"too many control cycles came late, .*real-time kernel") as raised:
        driver.drive(lambda state, dt_s: (list(Q_RAD), False))
    assert raised.value.kind == FAULT


@pytest.mark.parametrize("model", MODELS)
def test_an_arm_that_stops_and_falls_silent_leaves_its_last_words(model: str) -> None:
    driver, sdk = connected(model)
    sdk.fails["command"] = RuntimeError("libfranka: Move command aborted!")

    def step(state: Any, dt_s: float) -> tuple[list[float], bool]:
        sdk.fails["read_once"] = RuntimeError("libfranka: UDP receive: Timeout")
        return list(Q_RAD), False

    with pytest.raises(Failure, match="aborted!"):
        driver.drive(step)
    with pytest.raises(Failure) as raised:
        driver.recover()
    assert raised.value.kind == LOST
