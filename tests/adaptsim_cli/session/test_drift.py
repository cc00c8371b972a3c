"""A picture that has changed since the first trial is named, with the numbers."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console
from toy_rig import ToyLab, on_rig
from toy_session import ScriptedOperator, attended

from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.flow import run_iteration
from adaptsim_cli.session.preflight import drift
from adaptsim_cli.session.records import RigFacts


def facts(grey: float | None = 84.0, exposure_us: int = 8330, told: bool = True) -> RigFacts:
    film = {"exposure_us_and_white_balance_K": [[exposure_us, 4500]]} if told else None
    return RigFacts(brightness=grey, camera={"serial": "1", "recording": film})


@pytest.mark.parametrize("now", [facts(), facts(90.0), facts(None), facts(told=False), RigFacts()])
def test_what_stays_is_not_said(now: RigFacts) -> None:
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
def test_what_drifts_is_said(now: RigFacts, said: str) -> None:
    assert said in str(drift(facts(), now))


class Telling:
    """An attendant of a lab without a pedal, whose camera exposes otherwise from the third trial on."""

    def __init__(self) -> None:
        self.asked = 0

    def recover(self) -> None: ...

    def prepare(self, what: str) -> None: ...

    def facts(self) -> RigFacts:
        self.asked += 1
        return facts(None, 8330 if self.asked < 3 else 2500).model_copy(update={"pedal": "waived"})


def test_a_session_says_it_after_the_trial_and_keeps_what_the_rig_said(tmp_path: Path) -> None:
    said = io.StringIO()
    session = attended(tmp_path, ScriptedOperator(), ToyLab(0))
    rig = replace(on_rig(session.parts).rig, attendant=Telling())
    parts = replace(session.parts, target=replace(on_rig(session.parts), rig=rig))
    run_iteration(replace(session, parts=parts, screen=Screen(console=Console(file=said, width=300))))
    assert said.getvalue().count("The camera's picture has changed: exposure and white balance are 2500 µs") == 2
    kept = list(session.store.rigs())
    assert [rig.pedal for rig in kept] == ["waived"] * 4
    assert [rig.brightness for rig in kept] == [40.0] * 4
