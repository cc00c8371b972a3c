"""Pairs of poses, of the hand in the base and of a target in the camera, as other programs store them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import simulated_views as rig
from campaigns import campaign
from documents import ROOT
from scipy.spatial.transform import Rotation

from adaptsim_cli.bench.calibration.solving import solve_folder
from calib.errors import UnusableViews, ViewFolderError
from calib.geometry import distance_mm, move
from hw.kinematics import forward
from hw.poses import inverse
from hw.types import Array

TRUE = rig.truth(3)
SETUP = """
camera = "fixed"
[board]
kind = "points"
[colour]
width = 1280
height = 720
K = [[610.0, 0.0, 639.5], [0.0, 610.0, 359.5], [0.0, 0.0, 1.0]]
"""


def pairs() -> tuple[Array, Array]:
    """(20, 4, 4) X_BF and X_CM with errors of half a millimetre and a tenth of a degree."""
    q_rad = np.stack([view.q_rad for view in rig.views(TRUE, seed=3)])
    X_CM = rig.board_in_camera(rig.SETUP.mounting, TRUE, forward(q_rad))
    errors = np.random.default_rng(0).standard_normal((len(q_rad), 6)) * np.repeat([1.7e-3, 0.5e-3], 3)
    return forward(q_rad), move(X_CM, errors)


def written(folder: Path, view: Callable[[Array, Array], dict[str, object]]) -> Path:
    folder.mkdir()
    (folder / "setup.toml").write_text(SETUP)
    for i, (X_BF, X_CM) in enumerate(zip(*pairs(), strict=True)):
        (folder / f"view-{i:02d}.json").write_text(json.dumps(view(X_BF, X_CM)))
    return folder


def quaternions(X_BF: Array, X_CM: Array) -> dict[str, object]:
    turn = Rotation.from_matrix([X_BF[:3, :3], X_CM[:3, :3]]).as_quat().tolist()
    hand = {"position_m": X_BF[:3, 3].tolist(), "quaternion_xyzw": turn[0]}
    return {**hand, "target_position_m": X_CM[:3, 3].tolist(), "target_quaternion_xyzw": turn[1]}


@pytest.mark.long
@pytest.mark.parametrize(
    "view", [lambda X_BF, X_CM: {"X_BF": X_BF.tolist(), "X_CM": X_CM.tolist()}, quaternions], ids=["matrix", "wxyz"]
)
def test_pairs_of_poses_are_solved(tmp_path, view):
    found = solve_folder(written(tmp_path / "pairs", view)).record
    assert len([one for one in found.views if one.used]) >= 18
    assert distance_mm(np.array(found.X_AC), TRUE.X_AC) < 2.0


def test_a_pose_of_the_camera_in_the_target_and_a_broken_one_are_refused(tmp_path):
    def flipped(X_BF: Array, X_CM: Array) -> dict[str, object]:
        X = X_CM.copy()
        X[2, 3] *= -1
        return {"X_BF": X_BF.tolist(), "X_CM": X.tolist()}

    with pytest.raises(ViewFolderError, match="in the camera, whose Z looks ahead"):
        solve_folder(written(tmp_path / "behind", flipped))
    with pytest.raises(ViewFolderError, match="target's pose cannot be used"):
        solve_folder(written(tmp_path / "short", lambda X, Y: {"X_BF": X.tolist(), "X_CM": Y[:3].tolist()}))


@pytest.mark.long
def test_the_script_of_the_page_reads_the_files_of_three_programs(tmp_path, monkeypatch):
    page = (ROOT / "docs/guide/foreign-views.md").read_text()
    (script,) = re.findall(r"<!-- file pose_pairs\.py -->\n```python\n(.*?)```", page, re.S)
    (tmp_path / "pairs").mkdir()
    (tmp_path / "pairs/setup.toml").write_text(SETUP)
    X_BF, X_CM = pairs()
    turns = [Rotation.from_matrix(X[:, :3, :3]).as_quat() for X in (X_BF, X_CM)]
    namespace: dict[str, object] = {}
    exec(script, namespace)
    easy = [
        {
            role: {
                "translation": dict(zip("xyz", X[i, :3, 3].tolist(), strict=True)),
                "rotation": dict(zip("xyzw", turn[i].tolist(), strict=True)),
            }
            for role, X, turn in (("robot", X_BF, turns[0]), ("optical", X_CM, turns[1]))
        }
        for i in range(20)
    ]
    head = "rx,ry,rz,rqx,rqy,rqz,rqw,tx,ty,tz,tqx,tqy,tqz,tqw"
    rows = [np.concatenate([X_BF[i, :3, 3], turns[0][i], X_CM[i, :3, 3], turns[1][i]]) for i in range(20)]
    (tmp_path / "poses.csv").write_text("\n".join([head, *(",".join(map(repr, row.tolist())) for row in rows)]))
    moveit = [
        {"effector_wrt_world": X_BF[i].ravel().tolist(), "object_wrt_sensor": X_CM[i].ravel().tolist()}
        for i in range(20)
    ]
    solved = []
    for read, content in (("easy_handeye", {"samples": easy}), ("table", tmp_path / "poses.csv"), ("moveit", moveit)):
        views = namespace[read](content)  # type: ignore[operator]
        for number, view in enumerate(views):
            (tmp_path / f"pairs/view-{number:02d}.json").write_text(json.dumps(view))
        solved.append(np.array(solve_folder(tmp_path / "pairs").record.X_AC))
    assert all(distance_mm(X, TRUE.X_AC) < 2.0 for X in solved)
    assert np.allclose(solved[0], inverse(inverse(solved[1])), atol=1e-6)


@pytest.mark.parametrize("first", campaign([("hand", "target"), ("hand",), ("stated",), ("target",)], 2), ids="-".join)
def test_quaternions_in_another_order_than_their_keys_say_are_named_with_the_order_that_fits(tmp_path, first):
    def view(X_BF: Array, X_CM: Array) -> dict[str, object]:
        stated: dict[str, Any] = {**quaternions(X_BF, X_CM)}
        for who, key in (("hand", "quaternion_xyzw"), ("target", "target_quaternion_xyzw")):
            if who in first or (who, *first) == ("hand", "stated"):
                stated[key] = np.roll(stated[key], 1).tolist()
        if "stated" in first:
            stated["quaternion"] = stated.pop("quaternion_xyzw")
        return stated

    names = {"hand": "quaternion_xyzw", "target": "target_quaternion_xyzw", "stated": "quaternion"}
    keys, folder = [names[who] for who in first], written(tmp_path / "pairs", view)
    if "stated" in first:
        with (folder / "setup.toml").open("a") as setup:
            setup.write('[poses]\nquaternion = "xyzw"\n')
    with pytest.raises(UnusableViews) as refused:
        solve_folder(folder)
    message = str(refused.value)
    assert re.match(r"(18|19|20) of 20 views agree if ", message)
    for key in keys:
        assert f"{key} holds w first" in message
        assert f"{key} to {key.removesuffix('_xyzw')}_wxyz" in message
    assert message.count("holds") == len(keys)
