"""The time offset that a calibration found: where it comes from, what it changes, who says so."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import pytest
from mcap.reader import make_reader
from real_lab import calibration
from toy_rig import ToyLab, toy_parts
from toy_session import resolved

from adaptsim_cli.config import Config
from adaptsim_cli.errors import UsageError
from adaptsim_cli.session import recording, running
from adaptsim_cli.session.on_rig import OnRig
from adaptsim_cli.session.preflight import calibration_check
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import Parts
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
def test_it_is_read_from_the_stored_calibration(check: Check | None, late_s: float) -> None:
    stored = calibration().model_copy(update={"checks": () if check is None else (check,)})
    assert stored.hand_eye().camera_late_s == pytest.approx(late_s)


def parts(late_s: float) -> Parts:
    made = toy_parts(ToyLab(0))
    assert isinstance(made.target, OnRig)
    rig = made.target.rig
    eye = dataclasses.replace(rig.hand_eye, camera_late_s=late_s)
    target = dataclasses.replace(made.target, rig=dataclasses.replace(rig, hand_eye=eye))
    origin = dataclasses.replace(made.provenance, camera_late_s=late_s)
    return dataclasses.replace(made, target=target, provenance=origin)


def run(home: Path, late_s: float) -> SessionStore:
    @contextmanager
    def opened(config: Config, learnt: Path) -> Iterator[Parts]:
        yield parts(late_s)

    settings = resolved(home)
    request = running.SessionRequest(None, frozenset({"task"}), yes=True)
    path = running.run_session(settings, request, opened, lambda store: store.folder / "report.html")
    return SessionStore.open(settings.places.sessions, path.parent.name)


def test_it_is_subtracted_from_every_frame_and_noted(tmp_path: Path) -> None:
    aware, unaware = run(tmp_path / "aware", LATE_S), run(tmp_path / "unaware", 0.0)
    assert (aware.facts.camera_late_s, unaware.facts.camera_late_s) == (LATE_S, 0.0)
    files = [next(store.folder.rglob(recording.FILE)) for store in (aware, unaware)]
    kept, raw = (recording.read(path) for path in files)
    pairs = list(zip((kept.before, *kept.frames), (raw.before, *raw.frames), strict=True))
    assert len(pairs) > 5
    for a, b in pairs:
        assert b.t_s - a.t_s == pytest.approx(LATE_S, abs=1e-6)
    with files[0].open("rb") as stream:
        (attached,) = make_reader(stream).iter_attachments()
    assert json.loads(attached.data)["camera_late_s"] == LATE_S


def test_a_session_is_not_continued_with_another_one(tmp_path: Path) -> None:
    run(tmp_path, LATE_S)
    with pytest.raises(UsageError, match=r"the camera's time offset has changed .*\(25\.000 ms then, 0\.000 ms now\)"):
        run(tmp_path, 0.0)


def test_the_command_says_it() -> None:
    target = parts(LATE_S).target
    assert isinstance(target, OnRig)
    said = calibration_check(target.rig.hand_eye, 10**6, datetime.now(UTC))
    assert said.ok
    assert said.detail.endswith("25.0 ms subtracted from the camera's time stamps")
