"""The same real views in every convention that somebody might use: told, asked for, or recognised and said."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import real_views
from real_views import X_BF, corner_folder, postures_rad
from scipy.spatial.transform import Rotation

from adaptsim_cli.bench.calibration.detected_views import detect_views
from adaptsim_cli.bench.calibration.solving import solve_folder
from calib.errors import CalibrationError, UnusableViews, ViewFolderError
from calib.files import read_folder
from calib.foreign.chains import any_arm
from calib.geometry import distance_mm
from hw.kinematics import CRAIG, FLANGE_M
from hw.poses import inverse

Pose = Callable[[int], dict[str, Any]]


def read(folder: Path) -> tuple[np.ndarray, tuple[str, ...]]:
    """Poses (N, 4, 4) of the flange in the base, as the program reads them, and the conventions that it recognised."""
    stored = read_folder(folder, any_arm)
    looked = detect_views(stored)
    assert len(looked.views) == real_views.POSTURES
    poses = [stored.forward(view.q_rad) if view.X_BF is None else view.X_BF for view in looked.views]
    return np.array(poses), looked.recognised


def at(i: int) -> list[float]:
    return [float(v) for v in X_BF[i, :3, 3]]


def turn(i: int) -> Rotation:
    return Rotation.from_matrix(X_BF[i, :3, :3])


def wxyz(i: int) -> list[float]:
    return [float(v) for v in np.roll(turn(i).as_quat(), 1)]


def matrix(X: np.ndarray, per_m: float = 1.0) -> list[list[float]]:
    rows = X.copy()
    rows[:3, 3] *= per_m
    return [[float(v) for v in row] for row in rows]


def mm(i: int) -> list[float]:
    return [1e3 * v for v in at(i)]


TOLD: dict[str, tuple[Pose, str]] = {
    "w first": (lambda i: {"position_m": at(i), "quaternion_wxyz": wxyz(i)}, ""),
    "millimetres, w last": (lambda i: {"position_mm": mm(i), "quaternion_xyzw": turn(i).as_quat().tolist()}, ""),
    "matrix": (lambda i: {"X_BF": matrix(X_BF[i])}, ""),
    "matrix in millimetres": (
        lambda i: {"matrix": matrix(X_BF[i], 1e3)},
        '[poses]\nlength = "mm"\ngives = "flange_in_base"',
    ),
    "base in the flange": (
        lambda i: {"matrix": matrix(inverse(X_BF[i]))},
        '[poses]\nlength = "m"\ngives = "base_in_flange"',
    ),
    "roll, pitch, yaw in degrees": (
        lambda i: {"position_mm": mm(i), "euler": turn(i).as_euler("ZYX", degrees=True).tolist()},
        '[poses]\nangle = "deg"\neuler = "ZYX"',
    ),
    "rotation vector": (
        lambda i: {"position_m": at(i), "rotation_vector": turn(i).as_rotvec().tolist()},
        '[poses]\nangle = "rad"',
    ),
}

RECOGNISED: dict[str, tuple[Pose, str, str]] = {
    "millimetres, w last": (
        lambda i: {"position": mm(i), "quaternion": turn(i).as_quat().tolist()},
        "",
        'gives = "flange_in_base", length = "mm", quaternion = "xyzw"',
    ),
    "base in the flange": (lambda i: {"matrix": matrix(inverse(X_BF[i]))}, "", 'gives = "base_in_flange"'),
    "yaw, pitch, roll in degrees": (
        lambda i: {"position_m": at(i), "euler": turn(i).as_euler("ZYX", degrees=True).tolist()},
        "",
        'angle = "deg", euler = "ZYX"',
    ),
    "rotation vector in degrees": (
        lambda i: {"position_m": at(i), "rotation_vector": np.rad2deg(turn(i).as_rotvec()).tolist()},
        "",
        'angle = "deg"',
    ),
    "joints in degrees": (
        lambda i: {"joints": np.rad2deg(postures_rad()[i]).tolist()},
        'arm = "panda"',
        'angle = "deg"',
    ),
    "joints in rad": (lambda i: {"joints": postures_rad()[i].tolist()}, 'arm = "fr3"', 'angle = "rad"'),
}


@pytest.mark.parametrize("name", TOLD)
def test_a_convention_that_is_told(name, tmp_path):
    pose, extra = TOLD[name]
    poses, recognised = read(corner_folder(tmp_path, pose=pose, extra=extra))
    assert not recognised
    assert poses == pytest.approx(X_BF, abs=1e-9)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long if "w last" in name else ()) for name in RECOGNISED]
)
def test_a_convention_that_is_recognised_is_said(name, tmp_path):
    pose, extra, told = RECOGNISED[name]
    poses, recognised = read(corner_folder(tmp_path, pose=pose, extra=extra))
    assert told in " ".join(recognised)
    assert poses == pytest.approx(X_BF, abs=1e-5)


@pytest.mark.long
def test_a_reading_that_no_order_explains_is_refused_with_what_to_state(tmp_path):
    order = np.random.default_rng(3).permutation(real_views.POSTURES)
    folder = corner_folder(tmp_path, pose=lambda i: {"position": at(order[i]), "quaternion": wxyz(order[i])})
    with pytest.raises(UnusableViews, match=r"state in \[poses\].*quaternion \(wxyz or xyzw\)"):
        read(folder)


DH_CRAIG = [[a, np.arcsin(s), d, 0.0] for a, d, s in CRAIG] + [[0.0, 0.0, FLANGE_M, 0.0, 0]]
DH_CLASSIC = [
    [*((CRAIG[i + 1][0], np.arcsin(CRAIG[i + 1][2])) if i < 6 else (0.0, 0.0)), CRAIG[i][1] if i < 6 else FLANGE_M, 0.0]
    for i in range(7)
]


def urdf() -> str:
    joints = []
    for i, (a, alpha, d, *_) in enumerate(DH_CRAIG):
        x, y, z = Rotation.from_rotvec([alpha, 0, 0]).apply([a, 0, d])
        kind = "revolute" if i < 7 else "fixed"
        joints.append(
            f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
            f'<origin xyz="{x} {y} {z}" rpy="{alpha} 0 0"/><axis xyz="0 0 1"/></joint>'
        )
    links = "".join(f'<link name="l{i}"/>' for i in range(9))
    return f'<robot name="foreign">{links}{"".join(joints)}</robot>'


@pytest.mark.parametrize(
    "kinematics",
    [
        f'dh_convention = "craig"\ndh = {[[float(v) for v in row] for row in DH_CRAIG]}',
        f'dh_convention = "classic"\ndh = {[[float(v) for v in row] for row in DH_CLASSIC]}',
        'urdf = "foreign.urdf"',
        'urdf = "foreign.urdf"\nbase = "l0"\ntip = "l8"',
    ],
)
def test_joints_of_an_arm_by_its_own_kinematics(kinematics, tmp_path):
    folder = corner_folder(tmp_path, pose=_joints, extra=f"[kinematics]\n{kinematics}")
    (folder / "foreign.urdf").write_text(urdf())
    assert read(folder)[0] == pytest.approx(X_BF, abs=1e-5)


def _joints(i: int) -> dict[str, Any]:
    return {"q_rad": postures_rad()[i].tolist()}


@pytest.mark.parametrize(
    ("kinematics", "message"),
    [
        ("dh = [[0.0, 0.0, 0.333, 0.0]]", "say dh_convention"),
        ('dh_convention = "craig"\ndh = [[0.0, 90.0, 0.333, 0.0]]', "in rad, not in degrees"),
        ('dh_convention = "craig"\ndh = [[0.0, 0.0, 333.0, 0.0]]', "in m, not in mm"),
        ('dh_convention = "craig"\ndh = [[0.0, 0.0, 0.333, 0.0]]', "7 joints; this arm has 1"),
        ('urdf = "missing.urdf"', "cannot be read as URDF"),
        ('urdf = "foreign.urdf"\ntip = "l9"', "no chain from its root to l9"),
        ('urdf = "../foreign.urdf"', "without a folder"),
    ],
)
def test_kinematics_that_cannot_be_meant(kinematics, message, tmp_path):
    folder = corner_folder(tmp_path, pose=_joints, extra=f"[kinematics]\n{kinematics}")
    (folder / "foreign.urdf").write_text(urdf())
    with pytest.raises(ViewFolderError, match=message):
        read(folder)


@pytest.mark.parametrize("numbers", ["0 0", "0 0 0 0", "0 0 up", "0 0 nan"])
def test_a_urdf_needs_three_finite_numbers_for_a_place(numbers, tmp_path):
    folder = corner_folder(tmp_path, pose=_joints, extra='[kinematics]\nurdf = "foreign.urdf"')
    (folder / "foreign.urdf").write_text(urdf().replace("0 0 1", numbers))
    with pytest.raises(ViewFolderError, match=numbers):
        read(folder)


def test_a_urdf_whose_links_form_a_circle_is_refused(tmp_path):
    folder = corner_folder(tmp_path, pose=_joints, extra='[kinematics]\nurdf = "foreign.urdf"\ntip = "l8"')
    (folder / "foreign.urdf").write_text(urdf().replace('parent link="l2"', 'parent link="l5"'))
    with pytest.raises(ViewFolderError, match="the links above l8 form a circle"):
        read(folder)


def test_pictures_of_the_same_camera_at_another_resolution_are_recognised(tmp_path):
    folder = real_views.picture_folder(tmp_path)
    toml = (folder / "setup.toml").read_text()
    K = real_views.camera(2).K.copy()
    K[:2] *= 2.0
    told = toml.replace("width = 640", "width = 1280").replace("height = 480", "height = 960")
    (folder / "setup.toml").write_text(told.replace(str(real_views.camera(2).K.tolist()), str(K.tolist())))
    with pytest.raises(CalibrationError, match=r"scaled by 0\.5: width = 640, height = 480, K = \[\[612\.9"):
        read(folder)


@pytest.mark.long
def test_one_view_that_shows_nothing_or_is_damaged_costs_only_itself(tmp_path):
    folder = real_views.picture_folder(tmp_path / "pictures")
    (folder / "03.jpg").write_bytes((folder / "03.jpg").read_bytes()[:900])
    other = json.loads((folder / "view-05.json").read_text())
    (folder / "view-05.json").write_text(json.dumps({**other, "quaternion_xyzw": [1, 1, 0, 0]}))
    (folder / "07.jpg").write_bytes((real_views.DATA / "camera-0-09.jpg").read_bytes())  # of another camera
    reference = np.array(solve_folder(corner_folder(tmp_path / "corners")).record.X_AC)
    found = solve_folder(folder)
    told = " ".join([*found.not_seen, *(v.reason for v in found.record.views if not v.used)])
    assert "03.jpg" in told
    assert "of length 1" in told
    assert {v.name for v in found.record.views if not v.used} == {"07"}
    assert sum(v.used for v in found.record.views) == 17
    assert distance_mm(np.array(found.record.X_AC), reference) < 3.0
    assert found.record.board.kind == "marker"
    assert 39.5 < found.record.board.marker_mm < 40.2
