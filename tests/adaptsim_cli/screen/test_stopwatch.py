"""Every moment belongs to one stage, so the stages add up to the time that passed."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from adaptsim_cli.screen.stopwatch import Stopwatch, added


def ticking(*at_s: float) -> Stopwatch:
    times: Iterator[float] = iter(at_s)
    return Stopwatch(lambda: next(times))


def test_the_stages_add_up_and_what_has_no_name_is_other():
    watch = ticking(0.0, 1.0, 4.0, 6.0)
    with watch.stage("planning"):
        pass
    assert watch.lap_s() == {"other": pytest.approx(3.0), "planning": pytest.approx(3.0)}


def test_a_stage_within_another_keeps_its_time_to_itself():
    watch = ticking(0.0, 0.0, 2.0, 5.0, 6.0, 6.0)
    with watch.stage("placing"), watch.stage("answering"):
        pass
    assert watch.lap_s() == {"other": 0.0, "placing": pytest.approx(3.0), "answering": pytest.approx(3.0)}


def test_a_lap_may_fall_into_a_stage():
    watch = ticking(0.0, 1.0, 3.0, 10.0, 10.0)
    with watch.stage("storing"):
        assert watch.lap_s() == {"other": 1.0, "storing": 2.0}
    assert watch.lap_s() == {"storing": 7.0, "other": 0.0}


def test_laps_are_added_stage_by_stage_and_other_comes_last():
    assert list(added({"other": 1.0, "moving": 2.0}, {"moving": 3.0, "tracking": 1.0}).items()) == [
        ("moving", 5.0),
        ("tracking", 1.0),
        ("other", 1.0),
    ]
