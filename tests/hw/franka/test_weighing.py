"""Before its first motion an arm has to feel the load that it was told."""

from __future__ import annotations

import numpy as np
import pytest
from cells import cell
from players import arm_of
from sdk_fake import FakeSdk, alive

from hw.errors import MotionRefused
from hw.franka.motions import UNDECLARED_KG, undeclared_kg
from hw.franka.settings import FrankaSettings, Payload
from hw.kinematics import jacobian
from hw.types import Array, JointPath

COM_M = np.array([0.0, 0.0, 0.1])
SETTINGS = FrankaSettings("172.16.0.2", Payload(0.2, COM_M))


def feeling(extra_kg: float, error_Nm: float = 0.0) -> FakeSdk:
    def feels(q: list[float]) -> Array:
        return np.asarray(-9.81 * extra_kg * jacobian(np.array(q), COM_M)[2] + error_Nm)

    return FakeSdk(k=True, feels=alive(feels))


def still(q_rad: Array) -> JointPath:
    return JointPath(np.arange(50) / 1e3, np.tile(q_rad, (50, 1)))


@pytest.mark.parametrize("extra_kg", [0.6, 1.5, -0.7])
def test_another_load_than_declared_moves_nothing(extra_kg: float) -> None:
    sdk = feeling(extra_kg)
    with (
        arm_of(sdk, settings=SETTINGS) as arm,
        pytest.raises(MotionRefused, match="kg more or less than the decl") as refusal,
    ):
        arm.execute(still(arm.state().q_rad))
    felt_kg = float(str(refusal.value).split(" kg more")[0].split()[-1])
    assert felt_kg == pytest.approx(abs(extra_kg), abs=0.05), "but for the errors of the estimate"
    assert not any(name == "command" for name, _ in sdk.calls)
    loads = [what for name, what in sdk.calls if name == "set_load"]
    assert loads[0][0] == 0.2, "it was told before it was asked"


@pytest.mark.parametrize(("extra_kg", "error_Nm"), [(0.0, 0.8), (0.0, -0.8), (0.2, 0.0)])
def test_an_arms_own_errors_are_no_load(extra_kg: float, error_Nm: float) -> None:
    with arm_of(feeling(extra_kg, error_Nm), settings=SETTINGS) as arm:
        arm.execute(still(arm.state().q_rad))


@pytest.mark.long
def test_the_load_is_felt_once_and_again_for_another_tool() -> None:
    sdk = feeling(0.0)
    with arm_of(sdk, settings=SETTINGS) as arm:
        path = still(arm.state().q_rad)
        arm.execute(path)
        sdk.feels = feeling(1.0).feels  # an arm in contact after its first motion is not weighed
        arm.execute(path)
        arm.carry(cell("panda").tool, Payload(0.3, COM_M))
        with pytest.raises(MotionRefused, match=r"(0\.9|1\.0)\d kg more or less"):
            arm.execute(path)


def test_the_mass_is_that_of_the_least_squares_at_its_place() -> None:
    q_rad = np.array([0.3, -0.6, 0.2, -2.2, 0.1, 1.7, 0.5])
    pull = -9.81 * 1.25 * jacobian(q_rad, COM_M)[2]
    assert undeclared_kg(q_rad, pull, COM_M) == pytest.approx(1.25)
    assert undeclared_kg(q_rad, -pull, COM_M) == pytest.approx(1.25), "drivers differ in sign"
    assert undeclared_kg(q_rad, np.zeros(7), COM_M) == 0.0 < UNDECLARED_KG
