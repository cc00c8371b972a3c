"""Every page states the same worst stop: that of `hw.stopping`."""

from __future__ import annotations

import re

import pytest
from documents import ROOT

from adaptsim_cli.bench.devices.mounted import mounted_as_shipped
from adaptsim_cli.bench.doctor.assessment import planned_actions
from adaptsim_cli.bench.doctor.separation import INTRUSION_M, WALKING_M_S, separation_m
from adaptsim_cli.bench.rig_file.description import Model, PersonPart
from hw.braking import LONGEST_S
from hw.stopping import HEARD_S, LAG_S, NEXT_STOP_S, REDUCED_M_S, WORST_STOP_S, worst_stop
from hw.watchdog import SILENCE_S
from sim.tasks import get_task

DOCS = ROOT / "docs"
GUIDE, PEDAL, ARMS = (DOCS / "guide" / f"{name}.md" for name in ("operators-guide", "enable-pedal", "arms"))
MOTION, SPEEDS = DOCS / "results/motion.md", DOCS / "performance.md"
ROW = re.compile(r"^\| (scooping|pushing), (Panda|FR3) \| (0\.\d\d) s \| (\d+) cm \|$", re.MULTILINE)
BOUND, SEPARATION = f"{WORST_STOP_S:.2f} s", f"{separation_m(WORST_STOP_S):.2f} m"


def rows() -> list[tuple[str, Model, str, str]]:
    """(task, arm, time, way) of the table, as written."""
    models: dict[str, Model] = {"Panda": "panda", "FR3": "fr3"}
    return [(task, models[arm], time, way) for task, arm, time, way in ROW.findall(MOTION.read_text("utf-8"))]


def test_the_page_of_stops_lists_the_parts_of_the_bound():
    text = MOTION.read_text("utf-8")
    for part in (
        f"{1e3 * SILENCE_S:.0f} ms in which a silent pedal is not noticed",
        f"{1e3 * HEARD_S:.0f} ms until the player hears",
        f"{1e3 * NEXT_STOP_S:.0f} ms until the next moment",
        f"at most {LONGEST_S:g} s of braking",
        f"{1e3 * LAG_S:.0f} ms of the arm's lag",
        f"Together at most {BOUND}",
        f"{WALKING_M_S:g} m/s × {BOUND} + {INTRUSION_M:g} m of intrusion) is {SEPARATION}",
    ):
        assert part in text, part
    assert len(rows()) == 4


@pytest.mark.parametrize("page", [GUIDE, PEDAL, ARMS, SPEEDS], ids=lambda page: page.stem)
def test_a_page_that_speaks_of_a_stop_states_the_bound(page):
    text = page.read_text("utf-8")
    assert re.search(rf"(at most|\), ) ?{BOUND}", text)
    for other in ("15 cm", "0.5 s to rest", "within 0.4 s", "at most 0.4 s", "37 cm", "standstill within 0.5"):
        assert other not in text, other


@pytest.mark.parametrize("page", [GUIDE, PEDAL], ids=lambda page: page.stem)
def test_the_shipped_motions_are_those_of_the_table(page):
    slowest, farthest = max(time for _, _, time, _ in rows()), max(int(way) for *_, way in rows())
    assert re.search(
        rf"shipped motions (need )?at most {slowest} s, in which arm or tool (still )?travels up to {farthest} cm",
        page.read_text("utf-8"),
    )


def test_the_guide_states_separation_side_and_reduced_speed():
    text = GUIDE.read_text("utf-8")
    assert f"a separation of {SEPARATION}" in text
    assert f"the default side begins {PersonPart('left').from_m:g} m from its axis, which is nearer" in text
    assert f"faster than {1e3 * REDUCED_M_S:.0f} mm/s" in text


@pytest.mark.slow
@pytest.mark.parametrize(("name", "model", "time", "way"), rows())
def test_the_table_is_what_the_function_computes(name: str, model: Model, time: str, way: str) -> None:
    there = mounted_as_shipped(get_task(name), model)
    stop = worst_stop(there.cell, [path for action in planned_actions(there) for path in action])
    assert (f"{stop.time_s:.2f}", f"{100 * stop.distance_m:.0f}") == (time, way)
