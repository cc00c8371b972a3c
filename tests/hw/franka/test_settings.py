from __future__ import annotations

import numpy as np
import pytest

from hw.franka.settings import CollisionThresholds, FrankaSettings, Payload
from hw.limits import CONTACT_FORCE_N
from hw.motion_limits import RATED_NM


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
        (lambda: Payload(-0.1), r"must be 0 to 3"),
        (lambda: Payload(3.5), r"mass of the payload is 3\.5 kg"),
        (lambda: Payload(0.1, np.zeros(2)), "centre of mass"),
        (lambda: Payload(0.1, np.zeros(3), np.diag([1.0, 1.0, -1.0])), "symmetric and not negative"),
        (lambda: Payload(0.1, np.zeros(3), np.triu(np.ones((3, 3)))), "symmetric and not negative"),
        (lambda: CollisionThresholds(torque_contact_Nm=np.full(7, 10.5)), "contact .* is above collision"),
        (lambda: CollisionThresholds(torque_collision_Nm=np.full(7, 36.0)), "value 5 is 36, its limit 10.8"),
        (lambda: CollisionThresholds(torque_collision_Nm=RATED_NM), "value 1 is 87, its limit 78.3"),
        (lambda: CollisionThresholds(force_collision_N=np.full(6, 500.0)), "at most 100"),
        (lambda: CollisionThresholds(torque_collision_Nm=np.full(6, 50.0)), "shape"),
        (lambda: FrankaSettings("arm", joint_impedance_Nm_rad=np.zeros(7)), "above 0 and at most 14250"),
        (lambda: FrankaSettings("arm", joint_impedance_Nm_rad=np.full(7, np.nan)), "not finite"),
    ],
)
def test_what_cannot_be_is_refused_when_it_is_said(make: object, words: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=words):
        make()
