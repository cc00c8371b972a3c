"""The arm drawn into real pictures: a Panda before a RealSense camera (tests/data/panda-realsense)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import real_views
from replies import output, refused
from toy_session import silent

from adaptsim_cli.bench.calibration import pictures, running
from adaptsim_cli.bench.calibration.solving import SolvedFolder, SolveOptions, solve_folder
from calib.errors import UnusableViews


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    made = real_views.picture_folder(tmp_path_factory.mktemp("views"))
    (made / "setup.toml").write_text(real_views.setup_toml(2, real_views.ARUCO, 'arm = "panda"'))
    return made


@pytest.fixture(scope="module")
def solved(folder: Path) -> SolvedFolder:
    return solve_folder(folder)


def moved(solved: SolvedFolder, *mm: float) -> SolvedFolder:
    """The camera believed to be elsewhere by (x, y, z) of the base."""
    X = np.array(solved.record.X_AC)
    X[:3, 3] += 1e-3 * np.array(mm)
    told = tuple(tuple(map(float, row)) for row in X)
    return replace(solved, record=solved.record.model_copy(update={"X_AC": told}))


def test_the_hand_of_a_real_panda_lies_within_its_drawn_outline(solved):
    found = pictures.draw_arm(solved).fit
    assert found.shift_m < 0.005
    assert found.off_px < 4.0
    assert found.pictures >= 15


@pytest.mark.parametrize("mm", [(0, 20, 0), (0, 0, -20)])
def test_a_camera_that_is_believed_elsewhere_is_noticed(solved, mm):
    wrong = pictures.draw_arm(moved(solved, *mm))
    assert not wrong.fits
    assert f"{1e3 * wrong.fit.shift_m:.0f} mm" in wrong.sentence


def test_every_view_is_drawn_and_looks_other_than_before(folder, solved):
    drawn = pictures.draw_arm(solved)
    assert set(drawn.by_view) == {view.name for view in solved.views}
    name = next(iter(drawn.by_view))
    before = cv2.imread(str(folder / f"{name}.jpg"))
    assert 200 < (drawn.by_view[name] != before).any(axis=-1).sum() < 5000
    sheet = cv2.imdecode(np.frombuffer(drawn.sheet(), np.uint8), cv2.IMREAD_COLOR)
    assert sheet.shape == (960, 1920, 3)


@pytest.mark.long
def test_the_command_writes_the_pictures(folder, tmp_path):
    told = output("calibrate overlay", running.overlay(folder, tmp_path / "drawn", silent()))
    assert told["outline"]["fits"] is True
    assert Path(told["sheet"]).is_file()
    assert all(Path(path).is_file() for path in told["pictures"].values())


@pytest.mark.long
def test_solving_leaves_the_picture_beside_the_report(folder, tmp_path):
    stated = running.solve(folder, tmp_path / "report.html", SolveOptions(), silent())
    refused("calibrate solve", stated, "--refine-intrinsics")  # they state no distortion
    refined = running.solve(folder, tmp_path / "refined.html", SolveOptions(refine_intrinsics=True), silent())
    refused("calibrate solve", refined, "stated error")  # a third of the former one
    for name in ("report", "refined"):
        assert (tmp_path / name).with_suffix(".arm.jpg").is_file()
        assert (tmp_path / name).with_suffix(".residuals.csv").is_file()


@pytest.mark.long
def test_an_arm_of_unknown_looks_and_views_without_pictures_are_refused(tmp_path):
    with pytest.raises(UnusableViews, match=r'name the arm at the top of setup\.toml .*arm = "fr3"'):
        running.overlay(real_views.picture_folder(tmp_path / "unknown"), None, silent())
    bare = real_views.corner_folder(tmp_path, extra='arm = "panda"')
    with pytest.raises(UnusableViews, match="no pictures"):
        running.overlay(bare, None, silent())
