"""What a Franka arm refuses before its player hears of it, and how it hands a path over."""

from __future__ import annotations

import gc

import numpy as np
import pytest
from cells import READY, cell, move
from players import InstantPlayer

from hw.errors import ArmFault, DeviceUnavailable, MotionRefused
from hw.franka.arm import FrankaArm, open_franka
from hw.franka.driver import UNAVAILABLE, Failure
from hw.franka.settings import CollisionThresholds, FrankaSettings
from hw.types import ContactWindow, JointPath


def path(contact: ContactWindow | None = None, duration_s: float = 1.0, change_rad: float = 0.1) -> JointPath:
    return move(np.full(7, change_rad), duration_s, contact)


def arm(sink: InstantPlayer, model: str = "fr3") -> FrankaArm:
    return FrankaArm(cell(model), FrankaSettings("172.16.0.2"), lambda: sink)


def test_a_path_from_where_the_arm_is_held_is_handed_over_as_it_is() -> None:
    sink = InstantPlayer()
    with arm(sink) as one:
        one.execute(path())
    (motion,) = sink.given
    np.testing.assert_array_equal(motion.path.q_rad, path().q_rad)


def test_no_garbage_collection_makes_the_program_silent_during_a_motion() -> None:
    sink = InstantPlayer(collects_garbage=True)
    with arm(sink) as one:
        one.execute(path())
        assert not sink.collects_garbage
        with pytest.raises(MotionRefused):
            one.execute(path())
    assert gc.isenabled()


def test_a_bent_arm_is_led_from_its_held_joints_onto_the_path_within_the_limits() -> None:
    """The arm hangs 3 mrad below what its controller holds: the path is planned from the one, begun at the other."""
    off = 0.003 * np.array([0, 1, 0, -1, 0, 1, 0])
    sink = InstantPlayer(held_off_rad=off)
    with arm(sink) as one:
        one.execute(path())
    q = sink.given[0].path.q_rad
    np.testing.assert_allclose(q[0], READY + off)
    np.testing.assert_allclose(q[500:], path().q_rad[500:], atol=1e-12)
    assert cell("fr3").check(sink.given[0].path, READY + off).ok


def test_a_controller_that_holds_something_else_is_refused() -> None:
    sink = InstantPlayer(held_off_rad=0.02 * (np.arange(7) == 3))
    with arm(sink) as one, pytest.raises(MotionRefused, match=r"joint 4 starts 0\.02 rad from the position"):
        one.execute(path())
    assert sink.given == []


def test_a_contact_that_the_arm_would_take_for_a_collision_is_refused() -> None:
    settings = FrankaSettings("172.16.0.2")
    limit_N = settings.collision.contact_force_limit_N
    sink = InstantPlayer()
    soft = ContactWindow(0.2, 0.8, 0.001, 50.0)
    with arm(sink) as one:
        one.execute(path())
        one.execute(move(np.full(7, -0.1), 1.0, soft, sink.q_rad))  # from another posture than where it felt its load
    hard = FrankaSettings("172.16.0.2", collision=CollisionThresholds(force_collision_N=np.full(6, 40.0)))
    assert limit_N == 80.0
    again = InstantPlayer()
    with (
        FrankaArm(cell("fr3", stops_at_N=40.0), hard, lambda: again) as one,
        pytest.raises(MotionRefused, match="contact force"),
    ):
        one.execute(path(soft))
    assert again.given == []


@pytest.mark.parametrize(
    ("mode", "words"),
    [("UserStopped", "the stop button is pressed"), ("Guiding", "by hand"), ("Other", "unlock the joints")],
)
def test_an_arm_that_would_not_move_says_why(mode: str, words: str) -> None:
    sink = InstantPlayer(mode=mode)
    with arm(sink) as one:
        assert words in (one.state().fault or "")
        assert one.state().by_hand == (mode in ("UserStopped", "Guiding"))
        with pytest.raises(ArmFault, match=words):
            one.execute(path())
        with pytest.raises(ArmFault, match="recover"):
            one.recover()
        assert not one.state().by_hand, "it is remembered now, until it is recovered from"
    assert sink.given == []


def test_the_model_decides_the_limits() -> None:
    fast = path(duration_s=0.5, change_rad=0.27)  # 8.1 rad/s² for the FR3's 10; the Panda's joint 2 may do 7.5
    panda, fr3 = InstantPlayer(), InstantPlayer()
    with arm(panda, "panda") as one, pytest.raises(MotionRefused, match="acceleration of joint 2"):
        one.execute(fast)
    with arm(fr3, "fr3") as one:
        one.execute(fast)
    assert (len(panda.given), len(fr3.given)) == (0, 1)


def test_a_player_that_cannot_connect_leaves_the_arm_unentered() -> None:
    def fails() -> InstantPlayer:
        raise Failure(UNAVAILABLE, "no arm at 172.16.0.2")

    one = FrankaArm(cell("fr3"), FrankaSettings("172.16.0.2"), fails)
    with pytest.raises(DeviceUnavailable, match=r"no arm at 172\.16\.0\.2"):
        one.__enter__()
    with pytest.raises(DeviceUnavailable, match="is not connected: use it inside"):
        one.state()


def test_leaving_ends_the_player() -> None:
    sink = InstantPlayer()
    with arm(sink):
        assert sink.alive
    assert not sink.alive


def test_workcell_and_settings_agree_on_the_force_that_stops_the_arm() -> None:
    assert CollisionThresholds().contact_force_limit_N == cell().stops_at_N
    with pytest.raises(ValueError, match="stops by itself at 40 N, but by its settings at 80 N"):
        open_franka(cell("fr3", stops_at_N=40.0), FrankaSettings("172.16.0.2"))
