"""Guiding may end the connection at any moment: the person is asked to bring it back, and nothing is lost."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from board_rig import BOARD, MODEL, ToyBench, ToyHands, places, rig, store
from real_lab import quiet, said

from adaptsim_cli.bench.calibration import flow, touching
from adaptsim_cli.bench.calibration.board_mover import HandGuided
from adaptsim_cli.bench.calibration.flow import BoardViews
from adaptsim_cli.bench.calibration.store import Series
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.guided import GuidedArm
from calib import files
from calib.touch import MIN_TOUCHES
from hw.errors import DeviceUnavailable
from hw.types import ArmState, Array

KEPT = "Every view and touch so far is kept."
VIEWS = 1


@dataclass
class DroppingBench(ToyBench):
    """Its connection is lost at the state of that number, and comes back after so many questions."""

    drop_at: int = 0
    asked: int = 2
    states: int = 0

    def state(self) -> ArmState:
        self.states += 1
        if self.states == self.drop_at and self.asked:
            self.states -= 1
            raise DeviceUnavailable("fr3 at 172.16.0.2 does not answer (UDP receive: Timeout)")
        return super().state()


class Person:
    """Moves the board at every place, brings the connection back at the second question, and stops in the end."""

    def __init__(self, bench: DroppingBench, places_rad: Array, screen: Screen) -> None:
        self._bench, self._places, self._screen, self.at = bench, places_rad, screen, 0

    def readline(self) -> str:
        if "activate FCI. Done" in said(self._screen)[-140:]:
            self._bench.asked -= 1
            return "\n"
        if "Place" in said(self._screen)[-120:]:
            if self.at == VIEWS:
                return "q\n"
            self._bench.q_rad = self._places[self.at]
            self.at += 1
        return "\n"


def series_of(root: Path) -> Series:
    return store(root).series(files.setup_record(MODEL, BOARD, "panda", np.eye(4)), fresh=False)[0]


def guided(root: Path, bench: DroppingBench, monkeypatch: pytest.MonkeyPatch) -> tuple[Series, str]:
    """Two views by hand, then the touch check, then the end; the stored series and all that was shown."""
    screen = quiet()
    person = Person(bench, places(12), screen)
    monkeypatch.setattr("adaptsim_cli.screen.console.read_line", person.readline)
    plain = rig(bench, hands=ToyHands(bench))
    asking = replace(plain, arm=GuidedArm(plain.arm, screen, KEPT))
    series = series_of(root)
    with pytest.raises(StoppedByOperator):
        flow.visit_all(asking, series, HandGuided(screen), screen, BoardViews())
    touching.offer(asking, series, screen, unattended=False)
    return series, said(screen)


def content(series: Series) -> tuple[list[str], list[list[float]]]:
    folder = files.read_folder(series.folder)
    views_rad = [view.record.q_rad for view in folder.views]
    touched = files.read_touch(series.folder)
    assert touched is not None
    return [view.name for view in folder.views], [list(q) for q in (*views_rad, *touched[0].q_rad)]


@pytest.mark.long
def test_a_connection_that_is_lost_at_any_moment_costs_one_question_and_nothing_else(tmp_path, monkeypatch) -> None:
    whole, shown = guided(tmp_path / "whole", bench := DroppingBench(), monkeypatch)
    assert "connection" not in shown
    moments, expected = bench.states, content(whole)
    assert moments >= 4 * VIEWS + 3 * MIN_TOUCHES
    for moment in range(1, moments + 1):
        series, shown = guided(tmp_path / f"{moment}", DroppingBench(drop_at=moment), monkeypatch)
        assert content(series) == expected, f"lost at state {moment}"
        assert shown.count("switch the panda to Execution, unlock the joints and activate FCI. Done?") == 2
        assert shown.count(f"UDP receive: Timeout). Guiding may have ended it. {KEPT}") == 2
