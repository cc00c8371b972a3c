import numpy as np
import pytest
from cells import READY, cell, joint, move, smooth, stick
from hard_paths import LOADED, paths

from hw.braking import LONGEST_S, STOP_S, STOPS_EVERY_S, brake, check_braking, joint_spline, slowed
from hw.dynamics import torque_Nm
from hw.errors import MotionRefused
from hw.types import ContactWindow, JointPath

PANDA = cell("panda").motion


def path_of(duration_s: float, contact: ContactWindow | None = None) -> JointPath:
    t_s = np.arange(round(duration_s * 1000) + 1) / 1000
    share = smooth(t_s / t_s[-1])
    change = 0.55 * np.array([0.5, -0.3, 0.4, 0.2, 0.5, 0.3, -0.5])
    return JointPath(
        t_s, READY + np.column_stack([share, share**2, share, share, share**3, share, share]) * change, contact
    )


@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
@pytest.mark.parametrize("at_s", [0.0, 0.1, 0.35, 0.5, 0.73, 0.98, 1.0])
def test_a_stop_keeps_the_limits_and_stays_on_the_path(model: str, at_s: float) -> None:
    path = path_of(1.0)
    stopped = brake(path, at_s, cell(model).motion)
    assert cell(model).check(stopped, READY).ok
    before = stopped.t_s <= at_s
    assert np.allclose(stopped.q_rad[before], path.q_rad[: before.sum()], atol=1e-12)
    order = np.array([np.linalg.norm(path.q_rad - q, axis=1).argmin() for q in stopped.q_rad])
    off = np.linalg.norm(path.q_rad[order] - stopped.q_rad, axis=1)
    assert off.max() < 0.5 * np.linalg.norm(np.diff(path.q_rad, axis=0), axis=1).max() + 1e-9
    assert (np.diff(order) >= 0).all()


def test_every_moment_of_a_fast_path_can_be_braked() -> None:
    stops = check_braking(path_of(0.75), PANDA)
    assert stops.ok
    assert len(stops.at_s) == 38
    assert 0.04 < stops.longest_s <= LONGEST_S
    assert stops.duration_s[0] < stops.longest_s  # at rest there is nothing to stop


def test_a_path_over_the_limits_cannot_be_braked_and_is_refused() -> None:
    path = path_of(0.3)
    assert not check_braking(path, PANDA).ok
    with pytest.raises(MotionRefused, match="no stop"):
        brake(path, 0.15, PANDA)
    with pytest.raises(MotionRefused):
        cell().require(path, READY)


def test_the_contact_window_lasts_until_the_slowed_path_leaves_it() -> None:
    contact = ContactWindow(0.3, 0.6, 0.002, 10.0)
    path = path_of(1.0, contact)
    inside = brake(path, 0.4, PANDA).contact
    assert inside is not None
    assert inside.start_s == 0.3
    assert inside.end_s > 0.4
    assert brake(path, 0.1, PANDA).contact is None
    after = brake(path, 0.8, PANDA).contact
    assert after is not None
    assert (after.start_s, after.end_s) == (0.3, 0.6)
    stretched = brake(path, 0.58, PANDA).contact
    assert stretched is not None
    assert 0.6 < stretched.end_s < 0.64


def test_a_path_that_slows_down_at_its_limit_is_braked_as_fast_as_that_allows() -> None:
    """One profile of the clock for all paths took 0.6 s here: for half of the way the path brakes as hard as it may."""
    path = move(joint(1, 0.8), 0.8)
    assert 0.9 < cell("fr3").check(path).joint_ratio < 1.0
    stops = check_braking(path, cell("fr3").motion, 0.01)
    assert stops.ok
    assert stops.longest_s < 0.26
    clock = np.diff(stops.path_time_s, axis=1)
    assert (clock >= 0.0).all()
    assert (clock <= 1e-3 + 1e-12).all()
    assert (np.diff(clock, axis=1) <= 1e-12).all(), "it never gets faster again"


@pytest.mark.parametrize(("model", "seed"), [("panda", 5), ("fr3", 5)])
def test_no_stop_changes_a_torque_faster_than_the_arm_may_or_takes_longer_than_promised(model: str, seed: int) -> None:
    """Every stop of hard paths with a load, sample by sample."""
    cell_ = cell(model, LOADED)
    hard = ("near the limit", "all near the limit", "fast")
    stops = 0
    for one in paths(np.random.default_rng(seed), model):
        if one.kind not in hard or np.abs(one.q_rad).max() > 3.0:
            continue
        path = JointPath(np.arange(len(one.q_rad)) / 1e3, one.q_rad)
        if not cell_.check(path).ok:
            continue
        found = check_braking(path, cell_.motion, 0.01)
        spline = joint_spline(path)
        for at_s, duration_s, after_s in zip(found.at_s, found.duration_s, found.path_time_s, strict=True):
            if not np.isfinite(duration_s):
                continue
            s = np.concatenate([np.clip(at_s + np.arange(-3, 0) / 1e3, 0.0, None), after_s])
            q = np.concatenate([spline(s), np.repeat(spline(s[-1:]), 3, axis=0)])
            dq, ddq = np.diff(q, axis=0) * 1e3, np.diff(q, 2, axis=0) * 1e6
            torque = torque_Nm(model, q[2:], dq[1:], ddq, LOADED.mass)
            assert np.abs(np.diff(torque[2:], axis=0)).max() * 1e3 <= 1000.0 * (1.0 + 1e-6)
            assert round(1e3 * (2.0 * STOPS_EVERY_S + duration_s + 0.03)) <= round(1e3 * STOP_S), "in milliseconds"
            stops += 1
        if stops > 500:
            return


def path() -> JointPath:
    return move(np.full(7, 0.2), 1.0, ContactWindow(0.25, 0.5, 0.002, 10.0))


@pytest.mark.parametrize("pace", [0.1, 0.3, 0.77, 0.999])
def test_a_slower_path_visits_the_same_places_within_every_limit(pace: float) -> None:
    slow, within = slowed(path(), pace), cell("panda", stick((0.0, 0.0, 0.1)))
    assert slow.duration_s == pytest.approx(1.0 / pace, abs=1e-3)
    assert slow.contact is not None
    assert (slow.contact.start_s, slow.contact.end_s) == pytest.approx((0.25 / pace, 0.5 / pace))
    assert (slow.contact.depth_m, slow.contact.force_N) == (0.002, 10.0)
    np.testing.assert_array_equal(slow.q_rad[0], path().q_rad[0])
    np.testing.assert_allclose(slow.q_rad[-1], path().q_rad[-1], atol=1e-12)
    at = np.rint(slow.t_s * pace * 1e3).astype(int)
    step = np.abs(np.diff(path().q_rad, axis=0)).max()
    assert np.abs(slow.q_rad - path().q_rad[np.minimum(at, 1000)]).max() <= step
    fast = {check.quantity: check.ratio for check in within.require(path(), READY).checks}
    for check in within.require(slow, READY).checks:
        if check.quantity in ("velocity", "acceleration", "jerk", "travel speed"):
            assert check.ratio <= fast[check.quantity]


def test_full_pace_is_the_path_itself() -> None:
    one = path()
    assert slowed(one, 1.0) is one


@pytest.mark.parametrize("pace", [0.0, -1.0, 0.05, 1.1, float("nan"), float("inf")])
def test_no_other_pace(pace: float) -> None:
    with pytest.raises(ValueError, match="pace"):
        slowed(path(), pace)
