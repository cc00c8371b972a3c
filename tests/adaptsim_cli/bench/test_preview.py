"""A motion chosen by hand: what it uses of every limit, and the page that plays it."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from adaptsim_cli.bench.devices.mounted import mounted_as_shipped
from adaptsim_cli.bench.motion import planned
from adaptsim_cli.commands import app
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen import quantities
from sim.tasks import get_task

TASK = get_task("scooping")
PANDA = mounted_as_shipped(get_task("scooping"), "panda")


@pytest.mark.long
def test_the_table_and_the_page_of_a_scoop(tmp_path, capfd):
    page = tmp_path / "scoop.html"
    code = app.run(["preview", "--task", "scooping", "--action", "pitch_rate=0.2", "--json", "--html", str(page)])
    out, _ = capfd.readouterr()
    shown = json.loads(out)
    assert code == 0
    assert shown["action"]["pitch_rate"] == 0.2
    assert {row["path"] for row in shown["limits"]} == {"approach", "task", "way back"}
    assert all(0.0 <= row["ratio"] <= 1.0 for row in shown["limits"])
    assert any(row["quantity"] == "predicted contact force" for row in shown["limits"])
    assert page.stat().st_size > 100_000
    html = page.read_text(encoding="utf-8")
    assert "<title>scooping on panda: " in html
    (panel,) = re.findall(r'<details id="motion".*?</details>', html, re.DOTALL)
    assert "predicted contact force" in panel
    assert html != planned(PANDA, [], ["pitch_rate=-0.2"]).html()


def test_the_page_is_served_to_this_machine_alone():
    assert planned(PANDA, [], []).page().url.startswith("http://127.0.0.1:")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--action", "pitch"], "write name=value"),
        (["--context", "x=2"], "lies outside of"),
        (["--arm", "ur5"], "choose one of panda, fr3"),
        (["--task", "juggling"], "must be one of pendulum"),
    ],
)
def test_bad_values_are_named(arguments, message, refused):
    assert message in refused(2, "preview", *arguments)


def test_what_is_not_given_stays():
    otherwise = np.array([0.1, 0.06, 0.01])
    np.testing.assert_array_equal(
        quantities.point(TASK.action, ["pitch=0.05"], otherwise, "--action"), [0.1, 0.05, 0.01]
    )
    with pytest.raises(UsageError, match="--action"):
        quantities.point(TASK.action, ["distance=nan"], otherwise, "--action")
