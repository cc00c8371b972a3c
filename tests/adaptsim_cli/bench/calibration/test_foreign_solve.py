"""`calibrate solve` on real views of another lab: what is wrong is said, and what is offered mends it."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
import real_views
from replies import output, refused
from scipy.spatial.transform import Rotation
from toy_session import silent

from adaptsim_cli.bench.calibration import running
from adaptsim_cli.bench.calibration.solving import SolveOptions, solve_folder
from calib.errors import DegenerateViews, UnusableViews


def folder_with_swapped_views(folder: Path) -> Path:
    order = [12 if i == 5 else 5 if i == 12 else i for i in range(real_views.POSTURES)]
    return real_views.corner_folder(folder, pose=lambda i: real_views.as_told(real_views.X_BF[order[i]]))


@pytest.mark.long
def test_swapped_views_are_said_and_mended(tmp_path):
    folder = folder_with_swapped_views(tmp_path)
    # two views fewer, of a lens that is not stated
    told = refused("calibrate solve", running.solve(folder, None, SolveOptions(), silent()), "stated error")
    assert set(told["views_rejected"]) == {"05", "12"}
    (fault,) = told["faults"]
    assert fault["option"] == "--exchange 05:12"
    assert told["advice"].endswith("Solve again with --exchange 05:12")
    rows = list(csv.DictReader((folder / "residuals.csv").read_text().splitlines()))
    assert len(rows) == 4 * real_views.POSTURES
    far = {row["view"] for row in rows if float(row["off_mm"]) > 6.0}
    assert far == {row["view"] for row in rows if row["used"] == "0"} == {"05", "12"}
    exchanged = SolveOptions(exchange=(("05", "12"),))  # a lens that is not stated is in doubt
    mended = refused("calibrate solve", running.solve(folder, None, exchanged, silent()), "stated error")
    assert not mended["views_rejected"]
    assert not mended["faults"]


@pytest.mark.long
def test_views_outside_of_the_wished_ones_take_no_part(tmp_path):
    folder = real_views.corner_folder(tmp_path)
    found = solve_folder(folder, options=SolveOptions(first="03", last="16"))
    assert [view.name for view in found.record.views] == [f"{i:02d}" for i in range(3, 17)]
    with pytest.raises(UnusableViews, match=r"--until.*99"):
        solve_folder(folder, options=SolveOptions(last="99"))


@pytest.mark.long
def test_refined_intrinsics_are_stored_with_what_they_cost(tmp_path):
    """The factory states no distortion for this camera, and the views ask for k1 of about +0.1."""
    folder = real_views.corner_folder(tmp_path)
    plain = solve_folder(folder).record
    (said,) = [check.message for check in plain.checks if check.name == "intrinsics"]
    assert "k1 = +0.1" in said
    assert plain.refined_intrinsics is None
    answer = running.solve(folder, None, SolveOptions(refine_intrinsics=True), silent())
    assert answer.failure is None or "stated error" in str(answer.failure)
    told = output("calibrate solve", answer)
    assert 0.05 < told["refined_intrinsics"]["distortion"][0] < 0.2
    assert told["held_out_px"] < 0.7 * plain.held_out_px
    assert told["worst_95_mm"] < plain.uncertainty.worst_95_mm, "a lens in doubt costs more than an estimated one"


@pytest.mark.long
def test_together_judges_names_what_it_drops_and_mends_an_exchange(tmp_path, monkeypatch):
    folders = [real_views.corner_folder(tmp_path / f"camera-{k}", k) for k in (0, 1)]
    swapped = {name: (tmp_path / "camera-2" / f"view-{name}.json") for name in ("05", "12")}
    folders.append(real_views.corner_folder(tmp_path / "camera-2"))
    a, b = (json.loads(path.read_text()) for path in swapped.values())
    for path, record, other in zip(swapped.values(), (a, b), (b, a), strict=True):
        path.write_text(json.dumps(record | {"corners_px": other["corners_px"]}))
    monkeypatch.setattr("calib.gates.WORST_LIMIT_MM", 0.01)
    file = tmp_path / "together.json"
    told = refused("calibrate together", running.solve_cameras(folders, file, (), silent()), "camera-2: stated error")
    assert not told["accepted"]
    assert set(told["cameras"][2]["views_rejected"]) == {"05", "12"}
    assert "05 and 12 look swapped" in told["cameras"][2]["faults"][0]["what"]
    answer = running.solve_cameras(folders, file, [("camera-2", "05", "12")], silent())
    mended = refused("calibrate together", answer, "stated error")
    assert not mended["cameras"][2]["views_rejected"]
    assert mended["held_out_px"] < 0.9
    written = json.loads(file.read_text())
    assert written == {key: value for key, value in mended.items() if key not in ("file", "version")}
    with pytest.raises(UnusableViews, match="same name"):
        running.solve_cameras([folders[0], folders[0]], file, (), silent())
    with pytest.raises(UnusableViews, match="camera other"):
        running.solve_cameras(folders, file, [("other", "05", "12")], silent())


def test_one_repeated_pose_is_refused_in_words(tmp_path):
    folder = real_views.corner_folder(tmp_path, pose=lambda _: real_views.as_told(real_views.X_BF[0]))
    with pytest.raises(DegenerateViews, match="poses hardly turn"):
        solve_folder(folder)


def test_too_little_tilt_is_said_of_poses_whose_order_is_not_stated(tmp_path):
    """The true reason, not that no reading fits."""
    turn = Rotation.from_matrix(real_views.X_BF[0][:3, :3])
    folder = real_views.corner_folder(
        tmp_path,
        pose=lambda i: {"position": real_views.X_BF[i][:3, 3].tolist(), "quaternion": turn.as_quat().tolist()},
    )
    first = json.loads((folder / "view-00.json").read_text())["corners_px"]
    for path in folder.glob("view-*.json"):
        record = json.loads(path.read_text())
        record["corners_px"] = [[u + 3.0 * int(path.stem[-2:]), v] for u, v in first]
        path.write_text(json.dumps(record))
    with pytest.raises(DegenerateViews, match="same tilt"):
        solve_folder(folder)
