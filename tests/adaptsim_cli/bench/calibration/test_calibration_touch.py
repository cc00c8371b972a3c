"""The touched point from the question to the verdict, what devices tell of their temperature, and the mounting."""

from __future__ import annotations

import io
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from board_rig import NEAR_RAD, ToyBench, ToyHands, rig, run, store
from real_lab import quiet, said

from adaptsim_cli.bench.calibration import solving, touching
from adaptsim_cli.errors import StoppedByOperator
from calib.errors import CalibrationRejected, ViewFolderError
from calib.files import read_touch, setup_record, touch_files
from calib.saved import SavedCalibration
from calib.touch import MIN_TOUCHES
from calib.types import Check
from hw.kinematics import forward


def check(record: SavedCalibration, name: str) -> Check:
    return next(check for check in record.checks if check.name == name)


def views_of(root: Path) -> Path:
    return root / "calibrations/toy/views-0001"


@pytest.fixture(scope="module")
def touched(tmp_path_factory) -> tuple[Path, solving.SolvedFolder]:
    root, bench = tmp_path_factory.mktemp("touched"), ToyBench(warmth_C=lambda picture: 31.5)
    return root, run(root, bench, hands=ToyHands(bench))[0]


@pytest.fixture
def copied(touched: tuple[Path, solving.SolvedFolder], tmp_path) -> Path:
    folder = tmp_path / "views"
    shutil.copytree(views_of(touched[0]), folder)
    return folder


def edit(folder: Path, **values: object) -> None:
    path = folder / "touch.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | values))


@pytest.mark.long
def test_a_corner_is_seen_and_touched_at_the_same_place(touched):
    root, solved = touched
    found = check(solved.record, "touched point")
    assert found.verdict == "good"
    assert found.value is not None
    assert found.value < 1.5
    assert "4 touches agree to" in found.message
    assert (views_of(root) / touching.PICTURE).stat().st_size > 1000
    assert len(json.loads((views_of(root) / "touch.json").read_text())["q_rad"]) == MIN_TOUCHES


@pytest.mark.long
def test_temperatures_are_kept_where_devices_tell_them(touched):
    record = touched[1].record
    assert record.temperatures_C == {"arm": None, "camera": 31.5}
    assert check(record, "camera temperature").verdict == "good"


@pytest.mark.long
def test_a_camera_that_still_warms_up_is_suspect(tmp_path):
    record = run(tmp_path, ToyBench(warmth_C=lambda picture: 25.0 + 0.5 * picture))[0].record
    found = check(record, "camera temperature")
    assert found.verdict == "suspect"
    assert found.value == pytest.approx(4.0)
    assert "40 minutes" in found.message


@pytest.mark.long
def test_a_person_is_asked_before_each_touch_and_may_leave_it_out(tmp_path, monkeypatch):
    bench, screen = ToyBench(), quiet()
    monkeypatch.setattr("sys.stdin", io.StringIO("\n" * (1 + MIN_TOUCHES)))
    record = run(tmp_path / "yes", bench, screen=screen, hands=ToyHands(bench), unattended=False)[0].record
    assert check(record, "touched point").verdict == "good"
    assert "lay it flat in view of the camera" in said(screen)
    assert "Touch 4 of 4" in said(screen)
    for answers in ("n\n", "\n\nn\n"):
        bench, screen = ToyBench(), quiet()
        monkeypatch.setattr("sys.stdin", io.StringIO(answers))
        root = tmp_path / f"no{len(answers)}"
        record = run(root, bench, screen=screen, hands=ToyHands(bench), unattended=False)[0].record
        assert check(record, "touched point").verdict == "not measured"
        assert "no point is touched" in said(screen)
        assert record.accepted


@pytest.mark.long
def test_stopping_at_the_touch_loses_no_view(tmp_path, monkeypatch):
    bench = ToyBench()
    monkeypatch.setattr("sys.stdin", io.StringIO("q\n"))
    with pytest.raises(StoppedByOperator):
        run(tmp_path, bench, hands=ToyHands(bench), unattended=False)
    again = ToyBench()
    record = run(tmp_path, again, hands=ToyHands(again))[0].record
    assert again.motions == 0, "all views and the swing were there"
    assert check(record, "touched point").verdict == "good"


@pytest.mark.long
@pytest.mark.parametrize(("slips", "verdict"), [((1,), "good"), ((1, 5, 9), "not measured")])
def test_a_tip_that_slips_is_touched_again(slips, verdict, tmp_path):
    bench, screen = ToyBench(), quiet()
    hands = ToyHands(bench, slip_m=lambda number: 0.02 if number in slips else 0.0)
    record = run(tmp_path, bench, screen=screen, hands=hands)[0].record
    assert "the tip slipped, or the board did; touch again" in said(screen)
    assert check(record, "touched point").verdict == verdict
    assert record.accepted


def test_a_board_that_is_not_laid_in_view_is_said(tmp_path):
    bench, screen = ToyBench(), quiet()
    toy = rig(bench, hands=ToyHands(bench))
    series = store(tmp_path).series(setup_record(toy.camera.model(), toy.board, "panda"), fresh=True)[0]
    bench.paint = lambda image: np.full_like(image, 120)
    touching.offer(toy, series, screen, unattended=True)
    assert "again: 0 of the board's 17 markers" in said(screen)
    assert "no point is touched" in said(screen)
    assert not series.has_touch


@pytest.mark.long
def test_another_corner_than_the_one_stated_forbids_the_calibration(copied):
    corner = json.loads((copied / "touch.json").read_text())["corner"]
    edit(copied, corner=corner + 1)
    record = solving.solve_folder(copied).record
    found = check(record, "touched point")
    assert found.verdict == "bad"
    assert found.value == pytest.approx(40.0, abs=1.5)
    assert not record.accepted
    edit(copied, corner=99)
    with pytest.raises(ViewFolderError, match="corner 99; this board has 0 to 23"):
        solving.solve_folder(copied)


@pytest.mark.long
def test_a_refused_touch_leaves_what_is_in_use(tmp_path):
    bench = ToyBench()
    run(tmp_path, bench, hands=ToyHands(bench))
    before = store(tmp_path).current()
    bench = ToyBench()
    hands = ToyHands(bench, slip_m=lambda number: 0.04)  # the wrong corner, four times
    with pytest.raises(CalibrationRejected, match=r"touched point is 4\d\.\d mm"):
        run(tmp_path, bench, hands=hands)
    assert store(tmp_path).current() == before
    again = ToyBench()
    record = run(tmp_path, again, hands=ToyHands(again))[0].record
    assert again.motions == 0, "the views are still good"
    assert check(record, "touched point").verdict == "good"


@pytest.mark.long
def test_poses_serve_where_joints_are_not_known(copied):
    stored = json.loads((copied / "touch.json").read_text())
    X_BF = forward(np.array(stored.pop("q_rad")))
    (copied / "touch.json").write_text(json.dumps(stored | {"X_BF": X_BF.tolist()}))
    assert check(solving.solve_folder(copied).record, "touched point").verdict == "good"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda folder: (folder / "touch.json").write_text("{"), r"touch\.json is not valid JSON"),
        (lambda folder: edit(folder, q_rad=None), "exactly one of q_rad and X_BF"),
        (lambda folder: edit(folder, q_rad=[[0, -45, 0, -135, 0, 90, 45]] * 4), "not in degrees"),
        (lambda folder: (folder / "touch.png").write_bytes(b"half"), r"touch\.png does not match touch\.json"),
        (lambda folder: (folder / "touch.png").unlink(), r"touch\.png, named by touch\.json, is missing"),
    ],
)
def test_a_damaged_touch_is_named(change, message, tmp_path):
    for name, content in touch_files(np.zeros((360, 640, 3), np.uint8), 0, np.tile(NEAR_RAD, (MIN_TOUCHES, 1))).items():
        (tmp_path / name).write_bytes(content)
    assert read_touch(tmp_path) is not None
    change(tmp_path)
    with pytest.raises(ViewFolderError, match=message):
        read_touch(tmp_path)
