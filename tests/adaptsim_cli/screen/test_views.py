"""Numbers, ranges and categories as people read them."""

from __future__ import annotations

import io

import numpy as np
import pytest
from rich.console import Console

from adaptsim_cli.screen import views
from adaptsim_cli.session import terminal_views
from sim.types import Dimension, Space

GROUND = Dimension("ground", "", 0, 1, "integer", plain="ground", words=("ice", "wood"))
STIFFNESS = Dimension("e", "Pa", 1e4, 5e5, "log", plain="band stiffness")


@pytest.mark.parametrize(
    ("low", "high", "unit", "words"),
    [
        (1e4, 5e5, "Pa", "10 to 500 kPa"),
        (1e4, 1e6, "Pa", "10 to 1000 kPa"),
        (-0.1, 0.1, "m", "−100 to 100 mm"),
        (0.7, 1.0, "m", "0.7 to 1 m"),
        (-10.0, 100.0, "N m/rad", "−10 to 100 N m/rad"),
        (0.05, 0.2, "", "0.05 to 0.2"),
    ],
)
def test_a_range_has_the_unit_of_the_values_in_it(low: float, high: float, unit: str, words: str) -> None:
    assert views.span(low, high, unit) == words
    value = views.quantity(low + 0.3 * (high - low), unit)
    assert value.partition(" ")[2] == words.partition(" to ")[2].partition(" ")[2]


def test_the_changes_of_a_category_are_the_shares_of_its_words() -> None:
    before = np.array([[0.0, 2.5e4], [0.0, 2.5e4], [1.0, 2.5e4], [0.0, 2.5e4]])
    after = np.array([[1.0, 5e4]] * 4)
    table = terminal_views._changes(Space((GROUND, STIFFNESS)), [(before, after), (after, after)], first=0)
    console = Console(file=io.StringIO(), width=100)
    console.print(table)
    assert isinstance(console.file, io.StringIO)
    ground, stiffness = console.file.getvalue().splitlines()[-2:]
    assert " ".join(ground.split()) == "ground ice 75 %, wood 25 % → wood wood ="
    assert " ".join(stiffness.split()) == "band stiffness e [kPa] 25 ↑ 50 50 ="
