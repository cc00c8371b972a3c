"""What a confirmed arm says after a motion, and what is remembered of one that did not come to its end."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cells import cell
from real_lab import READY_RAD, quiet, said, typing

from adaptsim_cli.devices.confirmed import ConfirmedArm
from adaptsim_cli.devices.consent import Consent
from adaptsim_cli.devices.known_arm import KnownArm
from adaptsim_cli.screen.console import Screen
from hw.collision import LEVEL
from hw.errors import ArmFault, MotionRefused
from hw.fake import FakeArm, FakeClock, FakeGuardedArm
from hw.types import Execution, JointPath

STILL = JointPath(np.arange(11, dtype=np.float64) * 1e-3, np.tile(READY_RAD, (11, 1)))


def remembering(screen: Screen, known: KnownArm) -> Consent:
    return Consent(screen, "panda", operator="Kim", known=known, waived=("stop_button", "slow_start"))


def test_every_motion_says_how_many_commands_came_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    typing(monkeypatch, "panda")
    screen, rates = quiet(), [0.9995, 0.9312]

    class Late(FakeGuardedArm):
        notes = ("the processor may fall asleep",)

        def execute(self, path: JointPath) -> Execution:
            return replace(super().execute(path), control_success_rate=rates.pop(0))

    bare = Late(FakeArm(READY_RAD, FakeClock(), cell()), LEVEL)
    with ConfirmedArm(bare, Consent(screen, "panda", operator="Kim"), None) as arm:
        assert "the processor may fall asleep" in said(screen)
        arm.execute(STILL)
        assert "100.0 % of the commands reached the arm in time" in said(screen)
        assert "Only" not in said(screen)
        arm.execute(STILL)
    assert "Only 93.1 % of the commands reached the arm in time (at least 95 %)" in said(screen)
    assert "adaptsim doctor --hw panda" in said(screen)


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (ArmFault("panda stopped 0.4 s into the path: joint_reflex"), "joint_reflex"),
        (KeyboardInterrupt(), "KeyboardInterrupt"),
        (None, "the program ended during the motion: it was killed"),
    ],
)
def test_a_stop_is_never_forgotten(
    error: BaseException | None, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = KnownArm(tmp_path / "arms" / "panda-lab")

    class Stopping(FakeGuardedArm):
        wrong: BaseException | None = error

        def execute(self, path: JointPath) -> Execution:
            if self.wrong is not None:
                raise self.wrong
            return super().execute(path)

    def arm(screen: Screen) -> ConfirmedArm:
        typing(monkeypatch, "panda")
        bare = Stopping(FakeArm(READY_RAD, FakeClock(), cell()), LEVEL)
        return ConfirmedArm(bare, remembering(screen, known), None)

    if error is None:  # killed: nobody came to take the note away
        moving = known.moving()
        moving.__enter__()
    else:
        first = quiet()
        with arm(first) as moved, pytest.raises(type(error)):
            moved.execute(STILL)
        assert "last motion" not in said(first)
    screen = quiet()
    Stopping.wrong = None
    with arm(screen) as moved:
        moved.execute(STILL)
    assert why in said(screen)
    assert said(screen).index("Check before") < said(screen).index("Type panda to confirm")
    assert known.unended() is None, "a motion that ended well takes the note away"


def test_a_refused_motion_is_no_stop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    typing(monkeypatch, "panda")
    known = KnownArm(tmp_path)
    far = JointPath(STILL.t_s, STILL.q_rad + 0.5)
    bare = FakeGuardedArm(FakeArm(READY_RAD, FakeClock(), cell()), LEVEL)
    with (
        ConfirmedArm(bare, remembering(quiet(), known), None) as arm,
        pytest.raises(MotionRefused),
    ):
        arm.execute(far)
    assert known.unended() is None


def test_a_damaged_note_of_the_last_motion_counts_as_a_stop(tmp_path: Path) -> None:
    (tmp_path / "last-motion.json").write_text("{")
    assert KnownArm(tmp_path).unended() is not None
