"""Calibrations from the first picture to the stored result, and everything that can come between."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from board_rig import BOARD, X_BC, ToyBench, places, rig, run, store
from real_lab import quiet, said

from adaptsim_cli.bench.calibration import solving, taking
from adaptsim_cli.errors import DiskFull, PreflightFailed, UsageError
from calib.errors import CalibrationRejected, TooFewViews, ViewFolderError
from calib.target_records import BoardRecord
from hw.errors import ArmFault, CameraError
from perception.board.types import Board
from perception.errors import BoardMirrored, WrongBoard


def off_mm(X: object) -> float:
    return float(1e3 * np.linalg.norm(np.array(X)[:3, 3] - X_BC[:3, 3]))


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, solving.SolvedFolder, Path, str]:
    root, screen = tmp_path_factory.mktemp("done"), quiet()
    solved, folder = run(root, ToyBench(), screen=screen)
    return root, solved, folder, said(screen)


Done = tuple[Path, solving.SolvedFolder, Path, str]


def views_of(root: Path) -> Path:
    return root / "calibrations/toy/views-0001"


@pytest.fixture
def copied(done: Done, tmp_path: Path) -> Path:
    """The views of a good calibration, to be spoilt."""
    folder = tmp_path / "views"
    shutil.copytree(views_of(done[0]), folder)
    return folder


def solve(folder: Path) -> solving.SolvedFolder:
    return solving.solve_folder(folder)


@pytest.mark.long
def test_a_calibration_finds_the_camera_and_is_stored_whole(done: Done) -> None:
    root, solved, folder, text = done
    assert off_mm(solved.record.X_AC) < 1.5
    assert solved.record.accepted
    current = store(root).current()
    assert current == solved.record
    assert np.array_equal(current.hand_eye().X_BC, np.array(solved.record.X_AC))
    assert "12 of 12" in text
    assert "Accepted" in text
    page = (folder / "report.html").read_text()
    assert "data:image/jpeg" in page
    assert "http" not in page.replace("http://www.w3.org", ""), "self-contained"


def test_the_record_says_where_it_comes_from(done: Done) -> None:
    _, solved, _, _ = done
    record = solved.record
    assert record.folder == "views-0001"
    assert record.camera == "toy-camera"
    assert isinstance(record.board, BoardRecord)
    assert record.board.square_mm == pytest.approx(40.0)
    assert all(len(view.sha256) == 64 for view in record.views)
    measured = {check.name: check.verdict for check in record.checks}
    assert measured["time offset"] == "good"
    assert measured["touched point"] == "not measured"


def test_every_view_has_a_picture_to_look_at(done: Done) -> None:
    folder = views_of(done[0])
    names = {path.name.split(".")[0] for path in folder.glob("*.corners.jpg")}
    assert names == {path.stem.removeprefix("view-") for path in folder.glob("view-*.json")}


@pytest.mark.long
def test_a_cable_that_comes_loose_loses_nothing(tmp_path: Path) -> None:
    bench = ToyBench()

    def unplugged(_: ToyBench, picture: int) -> None:
        if picture == 7:
            raise CameraError("no frame within 1 s")

    bench.hooks = [unplugged]
    with pytest.raises(CameraError):
        run(tmp_path, bench)
    folder = views_of(tmp_path)
    before = {path: path.read_bytes() for path in folder.glob("view-*")}
    assert (
        len([path for path in before if path.suffix == ".json"]) == 5
    )  # the first picture was the check of the camera
    (folder / "view-006.png").write_bytes(b"half a picture, without its record")
    again, screen = ToyBench(), quiet()
    solved, _ = run(tmp_path, again, screen=screen)
    assert "Continuing with 5 stored views" in said(screen)
    assert {path: path.read_bytes() for path in before} == before
    assert len(solved.record.views) == 12
    assert again.motions == 7 + 2, "seven poses were left, then the swing and the way back"


@pytest.mark.long
def test_damaged_views_are_taken_again_and_a_missing_swing_is_filmed(tmp_path: Path) -> None:
    bench = ToyBench()

    def killed(_: ToyBench, picture: int) -> None:
        if picture == 9:
            raise KeyboardInterrupt

    bench.hooks = [killed]
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, bench)
    folder, screen = views_of(tmp_path), quiet()
    (folder / "view-002.json").write_text("{")
    (folder / "view-005.png").write_bytes((folder / "view-005.png").read_bytes()[:999])
    solved, stored = run(tmp_path, ToyBench(), screen=screen)
    assert "Continuing with 5 stored views" in said(screen)
    assert "taken again" in said(screen)
    assert len([view for view in solved.record.views if view.used]) == 12
    assert (folder / "view-002.json.damaged").exists()
    shutil.rmtree(stored)
    (folder / "motion.json").unlink()
    again = ToyBench()
    solved, _ = run(tmp_path, again)
    assert again.motions == 3, "to a place in view, the swing, and back"
    assert next(check for check in solved.record.checks if check.name == "time offset").verdict == "good"


@pytest.mark.long
def test_the_next_calibration_is_a_new_series_and_keeps_the_old_one(done: Done, tmp_path: Path) -> None:
    root = tmp_path / "copy"
    shutil.copytree(done[0], root)
    moved = X_BC.copy()
    moved[0, 3] += 0.010
    solved, folder = run(root, ToyBench(X_BC=moved))
    assert folder.name == "calibration-0002"
    assert (root / "calibrations/toy/calibration-0001/calibration.json").exists()
    assert store(root).current() == solved.record
    assert off_mm(solved.record.X_AC) == pytest.approx(10.0, abs=1.5)


def test_a_damaged_calibration_is_never_replaced_by_an_older_one_silently(done: Done, tmp_path: Path) -> None:
    root = tmp_path / "copy"
    shutil.copytree(done[0], root)
    file = root / "calibrations/toy/calibration-0001/calibration.json"
    file.write_bytes(file.read_bytes()[:200])
    with pytest.raises(Exception, match=r"not valid JSON.*remove it with its images.*calibrate restore"):
        store(root).current()


@pytest.mark.long
def test_a_full_disk_is_said_and_what_is_there_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, count = os.fsync, [0]

    def full(descriptor: int) -> None:
        count[0] += 1
        if count[0] > 20:
            raise OSError(28, "No space left on device")
        real(descriptor)

    with monkeypatch.context() as patch, pytest.raises(DiskFull):
        patch.setattr(os, "fsync", full)
        run(tmp_path, ToyBench())
    assert run(tmp_path, ToyBench())[0].record.accepted


@pytest.mark.long
def test_a_picture_of_another_time_is_not_paired(tmp_path: Path) -> None:
    bench, screen = ToyBench(), quiet()

    def late(bench: ToyBench, picture: int) -> None:
        if picture == 3:
            bench.t_s += 2.0

    bench.hooks = [late]
    run(tmp_path, bench, screen=screen)
    assert "12 of 12" in said(screen)


@pytest.mark.long
@pytest.mark.parametrize(("shaken", "told", "views"), [((5,), "1.00 mrad", 12), ((5, 6, 7), "view 004", 11)])
def test_an_arm_that_creeps_is_asked_again_and_a_view_that_never_rests_left_out(
    shaken: tuple[int, ...], told: str, views: int, tmp_path: Path
) -> None:
    bench, screen = ToyBench(), quiet()

    def creep(bench: ToyBench, picture: int) -> None:
        if picture in shaken:
            bench.q_rad = bench.q_rad + 1e-3

    bench.hooks = [creep]
    solved, _ = run(tmp_path, bench, screen=screen)
    assert told in said(screen)
    assert len(solved.record.views) == views
    assert off_mm(solved.record.X_AC) < 1.5


@pytest.mark.parametrize(
    ("bench", "error", "named"),
    [
        (ToyBench(printed=Board(7, 5, 0.040, 0.030, "5x5_100")), WrongBoard, "5x5"),
        (ToyBench(paint=lambda image: np.ascontiguousarray(image[:, ::-1])), BoardMirrored, "mirror"),
    ],
)
def test_another_board_and_a_mirrored_picture_are_named(
    bench: ToyBench, error: type[Exception], named: str, tmp_path: Path
) -> None:
    with pytest.raises(error, match=named):
        run(tmp_path, bench)


@pytest.mark.long
@pytest.mark.parametrize(
    ("spoilt", "named"),
    [
        ({"printed": Board(7, 5, 0.040, 0.030, "5x5_100")}, "5x5"),
        ({"paint": lambda image: np.ascontiguousarray(image[:, ::-1])}, "mirror"),
        ({"paint": lambda image: np.full_like(image, 120)}, "board"),
    ],
)
def test_a_bad_picture_costs_its_own_view_alone(spoilt: dict[str, object], named: str, tmp_path: Path) -> None:
    bench, screen = ToyBench(), quiet()
    good = {name: getattr(bench, name) for name in spoilt}

    def between(bench: ToyBench, picture: int) -> None:
        for name, value in (spoilt if picture == 5 else good).items():  # what the next picture shows
            setattr(bench, name, value)

    bench.hooks = [between]
    solved, _ = run(tmp_path, bench, screen=screen)
    (left_out,) = [line for line in said(screen).splitlines() if "left out" in line]
    assert named in left_out
    assert len([view for view in solved.record.views if view.used]) == 11
    assert off_mm(solved.record.X_AC) < 1.5


def test_without_a_board_it_says_so(tmp_path: Path) -> None:
    screen = quiet()
    with pytest.raises(TooFewViews, match="board"):
        run(tmp_path, ToyBench(paint=lambda image: np.full_like(image, 120)), places(12)[:3], screen)
    assert "0 of the board's 17 markers" in said(screen)


@pytest.mark.long
def test_a_board_held_upside_down_is_named_and_does_no_harm(tmp_path: Path) -> None:
    width, height = BOARD.size_m
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])
    turned[:2, 3] = width, height
    solved, _ = run(tmp_path, ToyBench(X_FM=ToyBench().X_FM @ turned))
    assert solved.record.accepted
    assert off_mm(solved.record.X_AC) < 1.5
    mounting = next(check for check in solved.record.checks if check.name == "board's mounting")
    assert mounting.verdict == "suspect"
    assert mounting.value == pytest.approx(180.0, abs=1.0)
    assert "upside down" in mounting.message


@pytest.mark.long
def test_a_print_that_is_too_small_is_refused_and_the_last_good_one_stays(done: Done, tmp_path: Path) -> None:
    root = tmp_path / "copy"
    shutil.copytree(done[0], root)
    small = Board(square_m=0.98 * BOARD.square_m, marker_m=0.98 * BOARD.marker_m)
    with pytest.raises(CalibrationRejected, match=r"squares are -\d\.\d+ %"):
        run(root, ToyBench(printed=small))
    assert store(root).current() == done[1].record
    assert "Not accepted" in (root / "calibrations/toy/views-0002/report.html").read_text()


def test_an_arm_with_a_fault_takes_no_view(tmp_path: Path) -> None:
    with pytest.raises(PreflightFailed, match="reflex"):
        run(tmp_path, ToyBench(fault="reflex"))

    def knocked(bench: ToyBench, picture: int) -> None:
        bench.fault = "reflex" if picture == 4 else None

    with pytest.raises(ArmFault, match="reflex"):
        run(tmp_path, ToyBench(hooks=[knocked]))


HELD = "somebody guides the arm by hand: let go of its buttons"


def test_an_arm_that_is_still_guided_is_waited_for() -> None:
    bench = ToyBench(fault=HELD, by_hand=True)
    waited_s: list[float] = []

    def pause(duration_s: float) -> None:
        waited_s.append(duration_s)
        if len(waited_s) == 30:
            bench.fault, bench.by_hand = None, False

    taking.look(replace(rig(bench), pause=pause))
    assert len(waited_s) == 31, "two readings at rest after the button was let go"
    assert bench.pictures == 1


def test_a_view_of_an_arm_in_somebodys_hands_does_not_count_and_says_what_to_do() -> None:
    bench = ToyBench(fault=HELD, by_hand=True)
    with pytest.raises(taking.ViewRefused, match=r"after 5 s still: .*let go of its buttons"):
        taking.look(rig(bench))
    assert bench.pictures == 0

    def grabbed(bench: ToyBench, picture: int) -> None:
        bench.fault, bench.by_hand = HELD, True

    with pytest.raises(taking.ViewRefused, match="let go of its buttons"):
        taking.look(rig(ToyBench(hooks=[grabbed])))


def test_a_dark_picture_is_refused_before_anything_moves(tmp_path: Path) -> None:
    bench = ToyBench(paint=lambda image: (image // 20).astype(np.uint8))
    with pytest.raises(PreflightFailed, match="add light"):
        run(tmp_path, bench)
    assert bench.motions == 0


def test_a_real_arm_never_moves_unasked(tmp_path: Path) -> None:
    bench = ToyBench()
    with pytest.raises(UsageError, match="never confirms the motion of a real arm"):
        run(tmp_path, bench, name="panda")
    assert bench.motions == 0


def test_a_truncated_view_is_left_out_and_named(copied: Path) -> None:
    picture = copied / "view-003.png"
    picture.write_bytes(picture.read_bytes()[:5000])
    (copied / "view-008.json").write_text('{"image": "view-008.png", ')
    (copied / "view-011.depth.png").unlink()
    solved = solve(copied)
    assert len(solved.views) == 9
    told = " ".join(solved.not_seen)
    for part in (
        "view-003.png does not match view-003.json",
        "view-008.json is not valid JSON",
        "view-011.depth.png",
    ):
        assert part in told


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda folder: (folder / "setup.toml").unlink(), r"setup\.toml is missing"),
        (lambda folder: (folder / "setup.toml").write_text("camera = "), r"setup\.toml is not valid TOML"),
        (lambda folder: edit(folder, 'arm = "panda"', 'arm = "other"'), "joints of an unknown arm"),
        (
            lambda folder: edit(folder, "height = 360", "height = 720"),
            "640 x 360, the intrinsics in .* are for",
        ),
        (lambda folder: edit(folder, "square_mm = 40.0", "square_mm = 0.04"), "square_mm: .*greater than 2"),
        (lambda folder: edit(folder, 'dictionary = "4x4_50"', 'dictionary = "9x9"'), "dictionary '9x9'"),
        (lambda folder: edit(folder, 'camera = "fixed"', 'camera = "fixed"\nlens = 3'), "lens.*known keys: .*board"),
        (lambda folder: [path.unlink() for path in folder.glob("*.json")], "no usable view"),
    ],
)
def test_a_malformed_folder_is_refused_by_name(change: object, message: str, copied: Path) -> None:
    change(copied)  # type: ignore[operator]
    with pytest.raises(ViewFolderError, match=message):
        solve(copied)


def edit(folder: Path, old: str, new: str) -> None:
    path = folder / "setup.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
