"""Every error that either SDK knows, and that the maker documents (`FLAGS`), has words of its own."""

from __future__ import annotations

import pytest
from franka_modes import FLAGS, PANDA_FLAGS

from hw.franka.reflexes import REASONS, in_words, reason


def names_of(errors: type) -> set[str]:
    return {name for name in dir(errors) if not name.startswith("_")}


def test_every_error_of_both_sdks_has_a_text() -> None:
    import pylibfranka  # noqa: PLC0415
    from panda_py import libfranka  # noqa: PLC0415

    fr3, panda = names_of(pylibfranka.Errors), names_of(libfranka.Errors)
    assert len(fr3) == len(FLAGS) == 41
    assert panda == set(FLAGS[:PANDA_FLAGS])
    assert set(REASONS) == fr3 == set(FLAGS)


def test_no_two_errors_are_told_alike() -> None:
    assert len({one.happened for one in REASONS.values()}) == len(REASONS)


@pytest.mark.parametrize("name", FLAGS)
def test_a_text_says_what_happened_where_to_look_and_what_to_do(name: str) -> None:
    one = REASONS[name]
    assert any(word in one.look for word in ("look", "check"))
    assert any(word in one.do for word in ("recover", "support"))
    said = in_words([name])
    assert said == f"{one.happened} ({name}); {one.look}; {one.do}"


def test_what_several_errors_share_is_said_once() -> None:
    lost = ("joint_motion_generator_velocity_discontinuity", "communication_constraints_violation")
    said = in_words(lost)
    assert all(f"({name})" in said for name in lost)
    assert said.count("check real-time kernel") == 1
    assert in_words([]) == ""


def test_an_error_of_a_later_arm_is_shown_by_its_name() -> None:
    assert reason("gripper_on_fire_violation").happened == "gripper on fire violation"
    assert "Desk" in in_words(["gripper_on_fire_violation"])
