"""The time offset that a calibration found: where it comes from, what it changes, who says so."""

from __future__ import annotations

import json
from datetime import UTC, datetime

import pytest
from mcap.reader import make_reader
from real_lab import calibration
from toy_rig import ToyLab, on_rig, toy_parts
from toy_session import RUN, call

from adaptsim_cli.session import recording
from adaptsim_cli.session.preflight import calibration_check
from adaptsim_cli.session.store import SessionStore
from calib.types import Check, Grade

LATE_S = 0.025


def measured(value_ms: float | None, verdict: str) -> Check:
    return Check(name="time offset", verdict=Grade(verdict), message="", value=value_ms, limit=5.0, unit="ms")


@pytest.mark.parametrize(
    ("check", "late_s"),
    [
        (measured(25.0, "suspect"), 0.025),
        (measured(-1.5, "good"), -0.0015),
        (measured(None, "not measured"), 0.0),
        (None, 0.0),
    ],
)
def test_it_is_read_from_the_stored_calibration(check, late_s):
    stored = calibration().model_copy(update={"checks": () if check is None else (check,)})
    assert stored.hand_eye().camera_late_s == pytest.approx(late_s)


def test_it_is_subtracted_from_every_frame_and_noted(undisturbed, place):
    code, told = call(place / "home", RUN, ToyLab(0), camera_late_s=LATE_S)
    assert code == 0, told
    aware = SessionStore.open(place / "home/data/sessions", "s")
    assert (aware.facts.camera_late_s, undisturbed.facts.camera_late_s) == (LATE_S, 0.0)
    files = [min(store.folder.rglob(recording.FILE)) for store in (aware, undisturbed)]
    kept, raw = (recording.read(path) for path in files)
    pairs = list(zip((kept.before, *kept.frames), (raw.before, *raw.frames), strict=True))
    assert len(pairs) > 5
    for a, b in pairs:
        assert b.t_s - a.t_s == pytest.approx(LATE_S, abs=1e-6)
    with files[0].open("rb") as stream:
        (attached,) = make_reader(stream).iter_attachments()
    assert json.loads(attached.data)["camera_late_s"] == LATE_S


def test_the_command_says_it():
    said = calibration_check(on_rig(toy_parts(ToyLab(0), camera_late_s=LATE_S)).rig.hand_eye, 10**6, datetime.now(UTC))
    assert said.ok
    assert said.detail.endswith("25.0 ms subtracted from the camera's time stamps")
