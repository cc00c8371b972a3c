"""What a rig says around a trial: a picture that has changed, facts that cannot be stored, a camera that is late; and a
slow pace, which is a rehearsal.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np
import pytest
from mcap.reader import make_reader
from real_lab import calibration, quiet, said
from toy_rig import ToyLab, rig_target, toy_parts
from toy_session import RUN, ScriptedOperator, attended, call, resolved, silent, unattended

from adaptsim_cli.bench.facts import RigFacts
from adaptsim_cli.screen import exit_codes
from adaptsim_cli.session import beginning, recording
from adaptsim_cli.session.flow import RunningSession, run_iteration
from adaptsim_cli.session.preflight import calibration_check, drift
from adaptsim_cli.session.rig_target import RigTarget
from adaptsim_cli.session.store import SessionStore
from calib.types import Check, Grade
from hw.errors import Rehearsed
from perception import raycasting
from sim.adaptation.stages import TrialKey


def facts(grey: float | None = 84.0, exposure_us: int = 8330, told: bool = True) -> RigFacts:
    film = {"exposure_us_and_white_balance_K": [[exposure_us, 4500]]} if told else None
    return RigFacts(brightness=grey, camera={"serial": "1", "recording": film})


@pytest.mark.parametrize("now", [facts(), facts(90.0), facts(None), facts(told=False), RigFacts()])
def test_what_stays_is_not_said(now):
    assert drift(facts(), now) is None
    assert drift(RigFacts(), now) is None


@pytest.mark.parametrize(
    ("now", "said"),
    [
        (facts(65.0), "23% darker than in the first trial (84 then, 65 of 255 now; at most 15%)"),
        (facts(120.0), "43% brighter"),
        (facts(exposure_us=2500), "are 2500 µs and 4500 K, 8330 µs and 4500 K in the first trial"),
    ],
)
def test_what_drifts_is_said(now, said):
    assert said in str(drift(facts(), now))


def test_a_missing_library_of_the_tracker_is_named_before_the_arm_moves(tmp_path, monkeypatch):
    """Open3D is imported only for the first film; without this check, the arm had made its first motion by then."""
    monkeypatch.setitem(raycasting.LIBRARIES, "libnosuch.so.9", "libnosuch9")
    lab = ToyLab(0)
    code, message = call(tmp_path, RUN, lab)
    assert code != 0
    assert "not ready, nothing has moved" in message
    assert "cannot load libnosuch.so.9: sudo apt-get install -y libnosuch9" in message
    assert lab.executions == []


@dataclass
class Attendant:
    """An attendant who gives these facts, trial by trial."""

    told: Iterator[RigFacts]

    def recover(self) -> None: ...

    def prepare(self, what: str) -> None: ...

    def facts(self) -> RigFacts:
        return next(self.told)


def test_a_session_says_it_after_the_trial_and_keeps_what_the_rig_said(tmp_path):
    session = attended(tmp_path, ScriptedOperator(), ToyLab(0))
    exposed = (
        facts(None, exposure_us).model_copy(update={"pedal": "waived"}) for exposure_us in (8330, 8330, 2500, 2500)
    )
    rig = replace(rig_target(session.parts).rig, attendant=Attendant(exposed))
    parts = replace(session.parts, target=replace(rig_target(session.parts), rig=rig))
    screen = quiet()
    run_iteration(replace(session, parts=parts, screen=screen))
    assert said(screen).count("The camera's picture has changed: exposure and white balance are 2500 µs") == 2
    kept = list(session.store.rigs())
    assert [rig.pedal for rig in kept] == ["waived"] * 4
    assert [rig.brightness for rig in kept] == [40.0] * 4


KEY, CONTEXT, ACTION = TrialKey(1, 0), np.array([0.68, 0.0]), np.array([0.5])


def slow(pace: float) -> RigTarget:
    target = rig_target(toy_parts(ToyLab(0)))
    return replace(target, rig=replace(target.rig, pace=pace))


@pytest.mark.parametrize("pace", [0.5, 1.0])
def test_below_full_pace_nothing_is_learnt_and_everybody_says_so(pace):
    target = slow(pace)
    planned = target.plan(target.place(CONTEXT, KEY, unattended()), ACTION)
    assert ("nothing is learnt" in planned.summary) == (pace < 1.0)
    executed = target.execute(planned)
    assert isinstance(executed.stopped, Rehearsed) == (pace < 1.0)
    assert "recording.mcap" in executed.files()


def test_a_rehearsed_trial_does_not_count_and_ends_the_command(tmp_path):
    parts = toy_parts(ToyLab(0))
    target = rig_target(parts)
    parts = replace(parts, target=replace(target, rig=replace(target.rig, pace=0.3)))
    settings = resolved(tmp_path)
    store = beginning.begin(settings.places.sessions, "s", settings.config, parts)
    with pytest.raises(Rehearsed, match=r"pace 0\.3 .*nothing is learnt .*without --pace") as raised:
        run_iteration(RunningSession(store, parts, unattended(), silent()))
    assert exit_codes.exit_code(raised.value) == 7
    existing = store.existing()
    assert existing.completed == {} or not existing.completed
    assert len(existing.rejected) == 1


def test_facts_that_cannot_be_stored_do_not_lose_the_recording():
    target = slow(1.0)
    rig = replace(target.rig, attendant=Attendant(iter([RigFacts().model_copy(update={"object_mass_kg": math.nan})])))
    target = replace(target, rig=rig)
    files = target.execute(target.plan(target.place(CONTEXT, KEY, unattended()), ACTION)).files()
    assert "recording.mcap" in files
    kept = json.loads(files["rig.json"])
    assert kept["object_mass_kg"] is None
    assert "JSON" in kept["problem"]


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
    code, told = call(place.parent / "home", RUN, ToyLab(0), camera_late_s=LATE_S)
    assert code == 0, told
    aware = SessionStore.open(place.parent / "home/data/sessions", "s")
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
    said = calibration_check(
        rig_target(toy_parts(ToyLab(0), camera_late_s=LATE_S)).rig.hand_eye, 10**6, datetime.now(UTC)
    )
    assert said.ok
    assert said.detail.endswith("25.0 ms subtracted from the camera's time stamps")
