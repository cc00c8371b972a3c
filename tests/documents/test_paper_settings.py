"""The paper's targets and studies: what the settings change, and a page from stored sessions alone."""

import numpy as np
import paper_settings as runs
import pytest
import results
from pages import paper_settings as page

from sim.research.benchmark.entries import Entry
from sim.tasks import get_task

SHIFT = np.array([0.0, 0.3, 0.0, 0.0])


def test_every_session_has_a_line_of_its_own():
    for wanted in ("table", "figure-a3", "figure-a5", "figure-a6"):
        keys = [(s.part, s.world, s.entry) for s in runs.settings(wanted)]
        assert len(set(keys)) == len(keys) > 3


def test_every_session_of_the_page_is_stored():
    stored = {(s.part, s.world, s.method, s.seed) for s in results.read(page.STORED)}
    for wanted in ("table", "figure-a3", "figure-a5", "figure-a6"):
        for setting in runs.settings(wanted):
            assert {(setting.part, setting.world, setting.entry, seed) for seed in runs.seeds_of(setting)} <= stored


def test_a_setting_moves_one_range_or_the_step_alone():
    usual, moved = (runs._checkpoint(shift, 0.0, Entry.parse(runs.PAPER)).solver.task for shift in (0.0, 0.3))
    assert moved.parameters.low == pytest.approx(usual.parameters.low + SHIFT)
    assert moved.parameters.high == pytest.approx(usual.parameters.high + SHIFT)
    faster = runs._checkpoint(0.0, 0.2, Entry.parse(runs.PAPER)).solver.task
    assert (faster.adaptation.delta, usual.adaptation.delta) == (0.2, get_task("pendulum").adaptation.delta)


def test_system_identification_in_a_moved_range_stays_there():
    told = runs._checkpoint(0.3, 0.0, Entry.parse(runs.SYSID)).solver.task
    assert np.array_equal(told.margin.low, told.parameters.low)
    assert told.parameters.low[1] == pytest.approx(1.3)


def test_a_stored_session_repeats():
    (line,) = [s for s in results.read(page.STORED) if (s.part, s.world, s.method, s.seed) == ("table", "wd", "udr", 0)]
    assert runs.session_of(runs.Setting("table", "wd", "udr"), 0) == line
