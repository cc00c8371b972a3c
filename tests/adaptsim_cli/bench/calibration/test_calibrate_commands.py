"""`adaptsim calibrate ...` as an operator meets it: what it asks, says, stores and returns."""

from __future__ import annotations

import io
import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from typing import cast

import cv2
import numpy as np
import pytest
from board_rig import COUNT, X_BC, ToyBench, places, rig, run
from PIL import Image
from real_lab import calibration, quiet, said

from adaptsim_cli import config
from adaptsim_cli.bench import calibration_in_use
from adaptsim_cli.bench.calibration import flow, printing, running, touching
from adaptsim_cli.bench.calibration.board_mover import Automatic, HandGuided
from adaptsim_cli.bench.calibration.parts import CalibrationRig
from adaptsim_cli.bench.devices.released import ReleasedArm
from adaptsim_cli.commands import app
from adaptsim_cli.config import Config
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.release import Release
from adaptsim_cli.session.preflight import calibration_check
from calib.errors import ViewFolderError
from calib.records import read
from calib.saved import SavedCalibration
from calib.types import HandEye
from hw.errors import CameraError
from hw.ports import Arm
from hw.types import Intrinsics
from perception.board import detect
from perception.board.types import Board

RUN = ["calibrate", "--world", "wd", "--seed", "0", "--yes"]


@pytest.fixture(autouse=True)
def wide(monkeypatch) -> None:
    monkeypatch.setenv("TERM", "dumb")
    monkeypatch.setenv("COLUMNS", "200")


@pytest.fixture
def bench(monkeypatch) -> ToyBench:
    """The commands run on a bench in memory, at places that are known to be reachable."""
    bench = ToyBench()

    @contextmanager
    def opened(
        _: Config, board: Board, known: SavedCalibration | None, screen: Screen | None = None
    ) -> Iterator[CalibrationRig]:
        release = Release(screen, "panda")
        arm = ReleasedArm[Arm](cast(Arm, bench), release)
        yield replace(rig(bench, board=board), arm=arm, release=release)

    monkeypatch.setattr(calibration_in_use, "open_calibration_rig", opened)
    monkeypatch.setattr(running, "plan", lambda _, count: places(COUNT)[:count])
    return bench


@pytest.mark.long
def test_a_calibration_from_the_command_line_and_what_follows(bench, capfd, printed):
    assert app.run([*RUN, "--json"]) == 0
    out, err = capfd.readouterr()
    found = json.loads(out)
    assert np.array(found["X_BC"]) == pytest.approx(X_BC, abs=2e-3)
    assert found["accepted"]
    assert len(found["views_used"]) == COUNT
    assert found["views_rejected"] == {}
    assert {"sigma_mm", "worst_95_mm", "held_out_px", "checks", "gates", "sha256"} <= found.keys()
    assert "SIMULATED" in err
    assert "12 of 12" in err

    resolved = config.load({"world": "wd", "seed": 0}, {"ADAPTSIM_HOME": os.environ["ADAPTSIM_HOME"]})
    eye, zeros = calibration_in_use.calibration_of(resolved.config, resolved.places, None)
    assert np.array_equal(eye.X_BC, np.array(found["X_BC"]))
    assert zeros.shape == (7,)
    other = resolved.config.model_copy(update={"seed": 1})
    assert calibration_in_use.current_calibration(other, resolved.places) is None, "another lab has another camera"

    assert printed("calibrate", "check", "--world", "wd", "--seed", "0", "--yes", "--json")["moved"] is False
    bench.X_BC = X_BC.copy()
    bench.X_BC[2, 3] += 0.004
    moved = printed("calibrate", "check", "--world", "wd", "--seed", "0", "--yes", "--json")
    assert moved["moved"] is True
    assert moved["moved_mm"] == pytest.approx(4.0, abs=1.5)
    assert "calibrate again" in moved["message"]


@pytest.mark.long
def test_what_stops_it_has_its_code_and_says_how_to_continue(bench, refused):
    def unplugged(_: ToyBench, picture: int) -> None:
        if picture == 4:
            raise CameraError("no frame within 1 s")

    bench.hooks = [unplugged]
    assert "Continue with: adaptsim calibrate" in refused(6, *RUN)
    bench.hooks = [lambda *_: (_ for _ in ()).throw(KeyboardInterrupt())]
    assert app.run(RUN) == 130
    bench.hooks = []
    bench.fault = "reflex"
    assert app.run(RUN) == 3
    bench.fault = None
    bench.printed = Board(7, 5, 0.0392, 0.0294)
    assert "measure the print" in refused(3, *RUN, "--fresh")


@pytest.mark.long
def test_two_calibrations_of_one_rig_never_run_at_once(bench, refused):
    assert app.run(RUN) == 0
    resolved = config.load({"world": "wd", "seed": 0}, {"ADAPTSIM_HOME": os.environ["ADAPTSIM_HOME"]})
    moved = bench.motions
    with calibration_in_use.calibrations(resolved.config, resolved.places).locked():
        for command in (RUN, ["calibrate", "check", *RUN[1:]]):
            assert "another calibration of this rig (lab-scooping-wd-seed0) is running" in refused(2, *command)
        assert app.run([*RUN[:-2], "1", "--yes"]) == 0, "another rig is free"
    assert bench.motions > moved
    assert app.run(["calibrate", "check", *RUN[1:]]) == 0


def test_nothing_to_check_and_no_terminal_are_said(bench, monkeypatch, refused):
    assert "there is no calibration of this rig to check" in refused(3, "calibrate", "check", "--yes")
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert "no terminal" in refused(2, "calibrate", "--world", "wd")


@pytest.mark.parametrize(
    ("typed", "motions"), [("q\n", 0), ("\n" * 9, 0), ("y\n" + "\n" * 9, 1), ("y\ny\nq\n", 1), ("y\npanda\n", 14)]
)
def test_the_first_motion_is_watched_before_one_answer_releases_the_rest(typed, motions, bench, monkeypatch):
    monkeypatch.setattr("adaptsim_cli.screen.console.require_terminal", lambda: None)
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    monkeypatch.setattr(touching, "offer", lambda *_, **__: None)
    code = app.run(["calibrate", "--world", "wd"])
    assert (code == 7) == (motions < 14)
    assert bench.motions == motions


def test_guiding_by_hand_asks_for_every_place(monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO("\n" * COUNT + "q\n"))
    screen, bench = quiet(), ToyBench()
    guided = HandGuided(screen)
    assert next(iter(guided.numbers({0, 1, 2}))) == 3
    for number in range(COUNT):
        bench.q_rad = places(COUNT)[number]
        assert guided.go(number, None).name == "THERE"
    assert f"Place {COUNT}. Enter when the arm is at rest" in said(screen)


@pytest.mark.long
def test_drift_uses_three_views_and_skips_those_without_a_board(tmp_path):
    solved, _ = run(tmp_path, ToyBench())
    bench, screen = ToyBench(), quiet()
    real = bench.paint
    seen = iter([True, False])
    bench.paint = lambda image: np.full_like(image, 120) if next(seen, False) else real(image)
    the_rig = rig(bench)
    going = Automatic(the_rig, screen, places(COUNT)[:6], bench.q_rad, unattended=True)
    found = flow.check(the_rig, solved.record, going, screen)
    assert not found.moved
    assert "place 1 left out" in said(screen)
    assert bench.motions == 5, "four places and the way back"


@pytest.mark.long
def test_the_board_is_printed_to_scale_and_its_measured_size_kept(place, printed):
    shown = printed("calibrate", "board", "--out", "board.png", "--width-mm", "258.3", "--json")
    assert shown["board"]["square_mm"] == pytest.approx(36.9)
    assert shown["nominal_square_mm"] == 37.0
    page = cv2.imread("board.png", cv2.IMREAD_GRAYSCALE)
    with Image.open("board.png") as file:
        px_per_mm = file.info["dpi"][0] / 25.4
    assert px_per_mm > 15
    assert page.shape == pytest.approx((210 * px_per_mm, 297 * px_per_mm), abs=1)
    scale = 0.25
    small = cv2.resize(page, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    flat = Intrinsics(small.shape[1], small.shape[0], np.array([[1000.0, 0, 800], [0, 1000.0, 600], [0, 0, 1]]))
    board = printing.fitting("a4", None)
    corners = detect(small, board, flat)
    assert len(corners) == board.corners
    first, last = corners.px[0], corners.px[5]
    assert np.linalg.norm(last - first) / (scale * px_per_mm) == pytest.approx(5 * 37.0, abs=0.05)
    kept = printing.stored_board(place.parent / "home/data")
    assert kept.measured
    assert kept.board.board().marker_m / kept.board.board().square_m == pytest.approx(0.75)


@pytest.mark.long
@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--width-mm", "245"], r"-5.4 % off the 259 mm that were printed"),
        (["--paper", "a5"], "one of a4, a3, letter"),
        (["--square-mm", "60"], "squares can be 5 to 37"),
        (["--out", "board.docx"], "one of .pdf, .png"),
    ],
)
def test_an_impossible_board_is_refused(flags, message, refused):
    assert message in refused(2, "calibrate", "board", *flags)


@pytest.mark.long
def test_a_pdf_has_the_size_of_the_paper():
    content = printing.page(printing.fitting("a4", None), "a4", ".pdf")
    assert content.startswith(b"%PDF")
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", content)
    assert [float(side) / 72 * 25.4 for side in box.groups()] == pytest.approx([297, 210], abs=0.01)


def test_views_from_elsewhere_that_are_not_there_end_with_8(refused):
    assert "there is no folder" in refused(8, "calibrate", "solve", "nowhere")


def test_an_old_calibration_is_warned_of():
    eye = HandEye(np.eye(4), 0.5, 0.02, "calibration of the panda, 2024-03-01", "2024-03-01T10:00:00+00:00")
    now = datetime(2024, 4, 20, tzinfo=UTC)
    old = calibration_check(eye, 30, now)
    assert old.ok
    assert "49 days old" in old.detail
    assert "adaptsim calibrate check" in old.detail
    assert "old" not in calibration_check(eye, 60, now).detail


def test_a_calibration_of_a_newer_version_is_used_without_its_additions(tmp_path):
    made = calibration()
    file = tmp_path / "calibration.json"
    table = json.loads(made.content()) | {"lens_age_days": 3}
    table["uncertainty"]["bias_mm"] = 0.1
    file.write_text(json.dumps(table))
    stored = read(SavedCalibration, file)
    assert stored.additions == ("lens_age_days", "uncertainty.bias_mm")
    assert np.array_equal(stored.hand_eye().X_BC, made.hand_eye().X_BC)
    assert json.loads(stored.content()) == table
    file.write_text(json.dumps(table | {"format": 2}))
    with pytest.raises(ViewFolderError, match=r"format 2; this version reads up to 1: update adaptsim"):
        read(SavedCalibration, file)
