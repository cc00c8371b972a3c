"""How long things took lately: remembered by place, told in every wait, and never a reason to fail."""

from __future__ import annotations

import io
from pathlib import Path

from rich.console import Console

from adaptsim_cli.screen import views
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.durations import Durations


def test_the_middle_of_the_last_five_is_expected_and_numbers_do_not_matter(tmp_path: Path) -> None:
    kept = Durations(tmp_path / "durations.json", "fake scooping wd")
    assert kept.expected_s("Tracking 57 frames") is None
    for seconds in (100.0, 2.0, 3.0, 4.0, 5.0, 6.0):
        kept.learn("Tracking 57 frames", seconds)
    again = Durations(tmp_path / "durations.json", "fake scooping wd")
    assert again.expected_s("Tracking 61 frames") == 4.0
    assert Durations(tmp_path / "durations.json", "fr3 scooping").expected_s("Tracking 57 frames") is None


def test_what_takes_no_time_is_not_remembered(tmp_path: Path) -> None:
    Durations(tmp_path / "durations.json", "here").learn("Storing", 0.1)
    assert not (tmp_path / "durations.json").exists()


def test_a_damaged_file_is_no_reason_to_fail(tmp_path: Path) -> None:
    file = tmp_path / "durations.json"
    for content in ("{", "[1]", '{"here": 3}', '{"here": {"Planning": "long"}}', '{"here": {"Planning": []}}'):
        file.write_text(content)
        assert Durations(file, "here").expected_s("Planning") is None


def test_every_wait_says_how_long_it_took_lately(tmp_path: Path) -> None:
    said = io.StringIO()
    screen, kept = Screen(console=Console(file=said, width=80)), Durations(tmp_path / "d.json", "here")
    kept.learn("Planning the motion", 12.0)
    screen.expect(kept)
    with screen.busy("Planning the motion", "planning"), screen.busy("Looking closer"):
        pass
    assert "Planning the motion (about 12 s)" in said.getvalue()
    assert set(screen.lap_s()) == {"planning", "Looking closer", "other"}
    assert set(screen.lap_s()) == {"other"}, "since the last call"


def test_a_wait_on_a_terminal_fits_on_one_line() -> None:
    text = views.waiting("Tracking the piece of food in 57 frames", 3.4, 8.0)
    assert text.plain[2:] == "Tracking the piece of food in 57 frames  3 s of about 8 s"
    said = io.StringIO()
    Console(file=said, width=30).print(views.waiting("A very long thing that is being done", 100.0, None))
    assert max(map(len, said.getvalue().splitlines())) <= 30
