"""The three arms are told apart by what they report; of joint limits the narrower count."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from arm_urdf import limited
from cells import READY, cell, move
from fr3_process import RELAXED, arm_at, fr3
from own_judge import MAKERS, SLOWER
from players import arm_of, driver_of
from sdk_fake import CommandException, FakeSdk

from adaptsim_cli.bench.rig_file.description import Model
from adaptsim_cli.config import Hardware
from calib.records import SetupRecord
from hw.dynamics import LINKS
from hw.errors import DeviceUnavailable, MotionRefused
from hw.franka.arm import franka
from hw.franka.connection import DRIVES
from hw.franka.identity import ALIKE, TITLES, ArmReport, identify, mass_matrix, narrowed
from hw.franka.settings import FrankaSettings
from hw.franka.versions import PACKAGES
from hw.joint_limits import LIMITS
from hw.mass import NOTHING
from hw.motion_limits import FLANGE
from sim.panda.model import urdf

FR3S = ("fr3", "fr3v2")
ROWS = list(zip(*MAKERS["fr3"][:3], strict=True))


def test_every_table_knows_every_arm() -> None:
    arms = set(LIMITS)
    assert arms == {"panda", "fr3", "fr3v2"}
    for table in (LINKS, FLANGE, DRIVES, PACKAGES, TITLES, MAKERS):
        assert set(table) == arms
    assert set(get_args(Model)) == arms
    assert set(get_args(Hardware)) == arms | {"fake", "own"}
    assert set(get_args(SetupRecord.model_fields["arm"].annotation)) == arms | {"other"}
    for model in arms:
        assert LIMITS[model].model == cell(model).motion.model == model
        assert f'name="{model}"' in urdf(model)


def test_the_limits_of_the_fr3_v2_are_the_narrower_of_both_published_ones() -> None:
    v2 = LIMITS["fr3v2"]
    assert v2.braking_offset_rad_s is not None and v2.braking_rad_s2 is not None
    np.testing.assert_array_equal(v2.braking_offset_rad_s, np.maximum(SLOWER["fr3"][0], SLOWER["fr3v2"][0]))
    np.testing.assert_array_equal(v2.braking_rad_s2, SLOWER["fr3v2"][1])
    np.testing.assert_array_equal(v2.q_max_rad, LIMITS["fr3"].q_max_rad)


@pytest.mark.parametrize("model", FR3S)
def test_the_mass_matrix_tells_the_fr3s_apart_in_every_posture(model: str) -> None:
    rng = np.random.default_rng(0)
    load = cell(model).tool.mass
    for q_rad in rng.uniform(LIMITS[model].q_min_rad, LIMITS[model].q_max_rad, (20, 7)):
        report = ArmReport(q_rad, mass_matrix(model, q_rad, load), load)
        for configured in FR3S:
            assert identify(configured, report).model == model


def test_a_mass_matrix_between_the_two_or_of_neither_tells_nothing() -> None:
    ours, others = (mass_matrix(model, READY, NOTHING) for model in FR3S)
    for matrix in ((ours + others) / 2.0, 1.1 * ours):
        identity = identify("fr3", ArmReport(READY, matrix))
        assert identity.model is None
        assert "none of fr3, fr3v2" in identity.why
    assert identify("fr3", ArmReport(READY, (1.0 + 0.3 * ALIKE) * ours)).model == "fr3"


@pytest.mark.parametrize(
    ("name", "masses", "model", "why"),
    [
        ("fr3v2", "", "fr3v2", "its own description calls it"),
        ("", "", None, "neither masses nor a description"),
        ("fr3v2_1", "fr3v2", None, "calls it 'fr3v2_1', which this program does not know"),
        ("fr3", "fr3v2", None, "calls it 'fr3' and has the masses of fr3v2"),
        ("fr3v2", "fr3v2", "fr3v2", "its mass matrix is that of fr3v2"),
    ],
)
def test_name_and_masses_have_to_agree(name: str, masses: str, model: str | None, why: str) -> None:
    matrix = mass_matrix(masses, READY, NOTHING) if masses else None
    identity = identify("fr3", ArmReport(READY, matrix, urdf=limited(name, ROWS) if name else ""))
    assert identity.model == model
    assert why in identity.why


def test_a_panda_is_told_by_its_interface_and_sends_no_library() -> None:
    sdk = FakeSdk(k=True, of="fr3")
    report = driver_of(sdk).report()
    assert report.mass_kg_m2 is None
    assert identify("panda", report).model == "panda"


@pytest.mark.parametrize(("says", "inside"), [("fr3", "fr3v2"), ("fr3v2", "fr3")])
def test_another_arm_than_that_of_the_rig_file_is_refused(says: str, inside: str) -> None:
    sdk = FakeSdk(k=False, of=inside)
    with pytest.raises(DeviceUnavailable, match=rf"the rig file says {says}.*{TITLES[inside]}.*model = \"{inside}\""):
        arm_of(sdk, says).__enter__()
    with arm_of(FakeSdk(k=False, of=says), says) as arm:
        assert arm.notes == ()
        arm.execute(move(np.full(7, 0.02), 0.6, start_rad=arm.state().q_rad))


@pytest.mark.parametrize("model", FR3S)
def test_an_arm_that_does_not_tell_says_which_limits_apply(model: str) -> None:
    with arm_of(FakeSdk(k=False), model) as arm:
        (note,) = arm.notes
    assert "compare its type plate" in note
    assert f"masses and shape of {TITLES[model]} apply ({model})" in note


def test_the_narrower_of_the_arms_own_limits_counts_and_is_said() -> None:
    narrow = [*ROWS]
    narrow[0] = (-2.9007, 0.5, 2.62)
    narrow[5] = (0.3, 4.6216, 2.0)  # lower than the table allows, and slower
    with arm_of(FakeSdk(k=False, of="fr3", urdf=limited("fr3", narrow)), "fr3") as arm:
        assert [note.split(":")[0] for note in arm.notes] == ["joint 1", "joint 6", "joint 6"]
        assert "at most 0.5000 rad, the table of fr3 2.9007; the narrower counts" in arm.notes[0]
        q_rad = arm.state().q_rad
        with pytest.raises(MotionRefused, match="joint 1"):
            arm.execute(move([0.55, 0, 0, 0, 0, 0, 0], 2.0, start_rad=q_rad))
        arm.execute(move([0.04, 0, 0, 0, 0, 0, 0], 1.0, start_rad=q_rad))
    limits, said = narrowed(LIMITS["fr3"], limited("fr3", narrow))
    assert limits.q_min_rad[5] == LIMITS["fr3"].q_min_rad[5]
    assert limits.dq_max_rad_s[5] == 2.0
    assert len(said) == 3
    assert narrowed(LIMITS["fr3"], "") == (LIMITS["fr3"], ())
    assert narrowed(LIMITS["fr3"], limited("fr3", ROWS))[1] == ()


@pytest.mark.parametrize(
    "urdf_text",
    [
        "no description",
        limited("fr3", ROWS[:6]),
        limited("fr3", [(1.0, -1.0, 2.0)] * 7),
        limited("fr3", [(float("nan"), 1.0, 2.0)] * 7),
        '<!DOCTYPE robot [<!ENTITY a "b">]><robot name="fr3">&a;</robot>',
    ],
)
def test_a_description_that_cannot_be_read_is_said_and_changes_no_limit(urdf_text: str) -> None:
    with pytest.raises(ValueError):
        narrowed(LIMITS["fr3"], urdf_text)
    with arm_of(FakeSdk(k=False, of="fr3", urdf=urdf_text), "fr3") as arm:
        assert any("cannot be read" in note for note in arm.notes)


@pytest.mark.long
def test_the_makers_own_library_tells_the_fr3_from_the_fr3_v2_over_the_network() -> None:
    with fr3() as server:
        with arm_at(server) as arm:
            assert arm.notes == ()
        server.tell("model fr3v2")
        with pytest.raises(DeviceUnavailable, match="connected arm is an FR3 v2"):
            arm_at(server).__enter__()
        server.place(READY)
        with franka(cell("fr3v2"), FrankaSettings(server.host), RELAXED) as arm:
            assert arm.notes == ()
            arm.execute(move(np.full(7, 0.02), 0.6, start_rad=arm.state().q_rad))


def test_the_limits_of_a_narrowed_arm_keep_its_zeros() -> None:
    limits, _ = narrowed(replace(LIMITS["fr3"]), limited("fr3", [(low, high, 1.0) for low, high, _ in ROWS]))
    assert (limits.dq_max_rad_s == 1.0).all()
    assert limits.braking_rad_s2 is LIMITS["fr3"].braking_rad_s2


@pytest.mark.parametrize("error", [CommandException("libfranka: Get Robot Model command rejected"), ValueError("URDF")])
def test_an_arm_whose_description_fails_is_read_all_the_same(error: Exception) -> None:
    sdk = FakeSdk(k=False, of="fr3", fails={"load_model": error})
    with arm_of(sdk, "fr3") as arm:
        assert "report does not show its model" in arm.notes[0]
        assert arm.state().fault is None
