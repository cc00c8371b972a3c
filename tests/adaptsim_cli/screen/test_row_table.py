"""Tables and values at terminals of any width: nothing is cut, and no value is parted from its unit."""

from __future__ import annotations

import io

import pytest
from rich.console import RenderableType
from rich.text import Text

from adaptsim_cli.screen import views
from adaptsim_cli.screen.clean_console import CleanConsole

HEAD = ("method", "reward", "above udr", "95 %", "gap closed", "worse")
ROW = ("adaptsim-no-discrepancy", "0.913", "+0.123", "+0.081 to +0.165", "0.62", "3")


def shown(what: RenderableType, width: int) -> list[str]:
    file = io.StringIO()
    CleanConsole(file=file, width=width, markup=False, highlight=False).print(what)
    return [line.rstrip() for line in file.getvalue().splitlines()]


def table(width: int) -> list[str]:
    return shown(views.rows(HEAD, [ROW, ROW], right=range(1, 6), whole=(0, 3)), width)


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_every_cell_of_a_table_is_shown_whole_at_every_width(width: int) -> None:
    lines = table(width)
    assert max(map(len, lines)) <= width
    for text in (*" ".join(HEAD).split(), *ROW):
        assert any(text in line for line in lines), text


def test_a_table_that_does_not_fit_has_a_block_per_row() -> None:
    assert "method      adaptsim-no-discrepancy" in table(60)
    assert table(60).count("worse       3") == 2
    assert [line.split()[0] for line in table(120)[2:4]] == ["adaptsim-no-discrepancy"] * 2


def test_a_path_is_folded_rather_than_the_table_taken_apart() -> None:
    path = "/home/anna/adaptsim/checkpoints/scooping/default"
    lines = shown(views.rows(("task", "folder"), [("scooping", path)]), 40)
    assert lines[0].split() == ["task", "folder"]
    assert "".join(line[11:] for line in lines[2:]) == path


@pytest.mark.parametrize(
    "value",
    [
        "0.29 rad/s",
        "0.0012 N·m·s/rad",
        "0.0012 N m s/rad",
        "0.29 ± 0.03 rad",
        "−1.5 mm",
        "5e5 Pa",
        "95 %",
        "12 m/s²",
        "4\N{NO-BREAK SPACE}iterations",
    ],
)
def test_a_value_stays_on_one_line_with_its_unit(value: str) -> None:
    plain = value.replace("\N{NO-BREAK SPACE}", " ")
    for width in range(len(plain) + 2, 60):  # with the signs that stand beside it
        for what in (Text(f"The pitch rate was {value}, at most."), f"(now {value})"):
            assert sum(plain in line for line in shown(what, width)) == 1, width


def test_a_count_may_be_parted_from_its_noun() -> None:
    assert shown(Text("after 12 sessions"), 10) == ["after 12", "sessions"]


def test_a_value_that_is_wider_than_its_column_is_broken_at_the_space() -> None:
    assert shown(Text("0.0012 N·m·s/rad"), 10) == ["0.0012", "N·m·s/rad"]
