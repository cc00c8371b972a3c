"""Numbers that the generator fills in: how they are written, and the table of stops, which takes minutes to compute.

That the pages hold the numbers of today is part of `test_generated_pages.py`.
"""

from __future__ import annotations

import pytest
from pages import numbers

from adaptsim_cli.bench.devices.mounted import mounted_as_shipped
from adaptsim_cli.bench.doctor.assessment import planned_actions
from adaptsim_cli.bench.rig_file.description import Model
from hw.stopping import worst_stop
from sim.tasks import get_task

SESSIONS = (
    ("a", "udr", 0, 0.4),
    ("a", "adaptsim", 0, 0.6),
    ("a", "adaptsim", 1, 0.8),
    ("b", "udr", 0, 0.4),
    ("b", "adaptsim", 0, 0.3),
)
"""(world, method, seed, reward)"""


@pytest.mark.parametrize(
    ("old", "value", "new"),
    [
        ("0.00", 0.934, "0.93"),
        ("+0.000", 0.0204, "+0.020"),
        ("−0.5", 0.2, "+0.2"),
        ("1.0", -0.25, "−0.2"),
        ("7 %", 0.35, "35 %"),
        ("12", 26, "26"),
        ("drawn-2-16", "foods-5-18", "foods-5-18"),
    ],
)
def test_a_number_is_written_as_the_one_before_it(old, value, new, tmp_path, monkeypatch):
    monkeypatch.setattr(numbers, "NAMES", {"value": value})
    page = tmp_path / "page.md"
    page.write_text(f"It earns **{old}<!--= value -->** (3 sessions).", encoding="utf-8")
    assert numbers.with_numbers(page) == f"It earns **{new}<!--= value -->** (3 sessions)."


def test_an_expression_that_cannot_be_computed_is_named_with_its_page(tmp_path):
    page = tmp_path / "page.md"
    page.write_text('0.5<!--= mean("foods", "nobody") -->', encoding="utf-8")
    with pytest.raises(SystemExit, match=r'page\.md: mean\("foods", "nobody"\) cannot be computed'):
        numbers.with_numbers(page)


def test_the_numbers_are_those_of_the_table_of_sessions(tmp_path, monkeypatch):
    table = tmp_path / "sessions.csv"
    rows = ["part,world,method,seed,reward,after"]
    rows += [f"p,{world},{method},{seed},{reward},4:{reward / 2}" for world, method, seed, reward in SESSIONS]
    table.write_text("\n".join(rows), encoding="utf-8")
    monkeypatch.setattr(numbers, "SESSIONS", table)
    assert numbers.mean("p", "udr") == pytest.approx(0.4)
    assert numbers.mean("p", "adaptsim", "a") == pytest.approx(0.7)
    assert numbers.mean("p", "adaptsim", "a", sessions=1) == pytest.approx(0.6)
    assert numbers.mean("p", "udr", after=4) == pytest.approx(0.2)
    assert numbers.lead("p") == pytest.approx(0.05)
    assert (numbers.gaining("p"), numbers.worlds("p"), numbers.least_world("p")) == (1, 2, "b")
    assert numbers.least("p") == pytest.approx(-0.1)


def test_a_number_of_a_sealed_benchmark_is_of_all_worlds_or_of_one_stratum():
    name = "pushing-drawn"
    total, need = numbers.sealed_worlds(name), numbers.sealed_need(name)
    assert 0 < need < total
    for number in (numbers.sealed, numbers.sealed_lead):
        parts = [number(name, "udr", stratum=stratum) for stratum in ("in need", "others")]
        assert number(name, "udr") == pytest.approx((need * parts[0] + (total - need) * parts[1]) / total)


@pytest.mark.slow
@pytest.mark.parametrize(("task", "arm", "time", "travel"), numbers.stops())
def test_the_table_of_stops_is_what_the_function_computes(task: str, arm: str, time: str, travel: str) -> None:
    models: dict[str, Model] = {"Panda": "panda", "FR3": "fr3"}
    mounted = mounted_as_shipped(get_task(task), models[arm])
    stop = worst_stop(mounted.cell, [path for action in planned_actions(mounted) for path in action])
    assert (f"{stop.time_s:.2f}", f"{100 * stop.distance_m:.0f}") == (time, travel)


def test_the_table_of_stops_has_both_tasks_and_arms():
    assert len(numbers.stops()) == 4
