from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from toy_session import ScriptedOperator, attended

from adaptsim_cli.screen.svg import Scale, plain
from adaptsim_cli.session.flow import run_iteration
from adaptsim_cli.session.operator import Review
from adaptsim_cli.session.records import DimensionRecord
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import figures, page
from perception.types import Outcome


class Outline(HTMLParser):
    """Tags, in order, and whether they close; external references."""

    void = frozenset({"meta", "img", "line", "rect", "br"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.count: dict[str, int] = {}
        self.references: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.count[tag] = self.count.get(tag, 0) + 1
        self.references += [value or "" for key, value in attrs if key in ("src", "href")]
        if tag not in self.void and not self.get_starttag_text().endswith("/>"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.void:
            assert self.open.pop() == tag


@pytest.fixture(scope="module")
def store(tmp_path_factory) -> SessionStore:
    home = tmp_path_factory.mktemp("report")
    reviews: list[Review] = [Review(rejected="the <piece> was touched"), Review(Outcome.LOST)]
    session = attended(home, ScriptedOperator(reviews=reviews))
    for iteration in range(2):
        run_iteration(session)
        session.store.mark_shown(iteration, "2024-01-01T00:00:00+00:00")
    return session.store


def outline(html: str) -> Outline:
    found = Outline()
    found.feed(html)
    assert found.open == []
    return found


def test_the_page_holds_every_trial_what_the_operator_changed_and_where_the_numbers_come_from(store):
    html = page.render(store)
    found = outline(html)
    assert found.references
    within = [reference for reference in found.references if reference.startswith("#")]
    assert "#iteration-1" in within
    assert all(f'id="{reference[1:]}"' in html for reference in within)
    others = [reference for reference in found.references if reference not in within]
    assert others
    assert all(reference.startswith("data:image/jpeg;base64,") for reference in others)
    assert "http" not in re.sub(r"data:image/jpeg;base64,[^\"]+", "", html)
    assert found.count["article"] == html.count("camera image at contact") == 8
    assert html.count('class="dot') >= 8
    assert all(f"Trial {number}\n" in html for number in range(1, 9))
    assert "tracked as on blade" in html
    assert "Trial 1, attempt 1: the &lt;piece&gt; was touched" in html, "and text is escaped"
    for fact in ("Converged: estimated reward", "c" * 16, "h" * 16, "adaptsim 0.1.0"):
        assert fact in html


def test_a_session_without_a_complete_iteration_has_a_page_too(tmp_path):
    session = attended(tmp_path, ScriptedOperator())
    assert "No iteration is complete yet" in page.render(session.store)


def test_no_template_hides_a_figure():
    """`wide` and `narrow` are shown at one width only; only `page.both` may use them, as a pair."""
    for template in Path(page.__file__).parents[1].rglob("*.j2"):
        assert not re.search(r'class="[^"]*\b(wide|narrow)\b', template.read_text()), template.name


def test_ticks_are_round_and_inside():
    assert Scale(0.2, 0.4, 0, 100).ticks(4) == pytest.approx([0.2, 0.25, 0.3, 0.35, 0.4])
    assert Scale(1e4, 5e5, 0, 100, log=True).ticks() == [1e4, 1e5]
    assert Scale(1e4, 1e6, 0, 100, log=True)(1e5) == pytest.approx(50)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.25, "0.25"), (-0.02, "−0.02"), (1e5, "10⁵"), (3.88e5, "3.88 · 10⁵"), (0, "0"), (2e-4, "2 · 10⁻⁴")],
)
def test_numbers_read_well(value, text):
    assert plain(value) == text


def test_a_trial_with_a_goal_tells_how_far_it_missed_it(store):
    record = store.trials(0)[0]
    x, y = record.track.state[-1][:2]
    aimed = record.model_copy(update={"goal_m": (x + 0.03, y - 0.04)})
    assert aimed.off_goal_mm == pytest.approx(50.0)
    assert record.off_goal_mm is None
    drawn = figures.table_view([aimed], store.facts.context, 1)
    assert drawn.count('class="miss c0"') == 1
    assert "miss" not in figures.table_view([record], store.facts.context, 1)


def test_the_times_of_an_iteration_add_up(store):
    table = re.search(r'<h2 id="time">Time</h2>.*?<table class="times">.*?</table>', page.render(store), re.DOTALL)
    cells = re.findall(r'<td>([^<]+)</td><td class="n" data-label="iteration 1">([\d.]+)</td>', table[0])
    spent = {stage: float(seconds) for stage, seconds in cells}
    del spent["next proposal, after the last trial"]
    total = spent.pop("total")
    assert {"moving", "tracking", "other"} <= set(spent)
    assert sum(spent.values()) == pytest.approx(total, abs=0.05 * (len(spent) + 1))


def test_trials_held_out_say_whether_to_believe_the_posterior():
    held = figures.HeldOutScore(16, 64, (0.9, 0.8, 1.0), (0.5, 0.4, 0.6), 0.97, before=0.25, after=0.006)
    assert held.in_words.startswith("Believe the posterior")
    assert replace(held, after=0.25).in_words.startswith("Do not believe the posterior")


def test_a_line_never_breaks_within_a_quantity(store: SessionStore) -> None:
    (first, *_) = re.findall(r'<p class="detail">([^<]+)</p>', page.render(store))
    assert all(" " not in part for part in first.replace(" · ", ", ").strip().split(", "))


def test_the_default_place_is_the_session_folder_and_it_is_replaced(store: SessionStore) -> None:
    assert page.write(store) == page.write(store) == store.folder / "report.html"


@pytest.mark.parametrize("count", [2, 5, 21, 80])
def test_the_numbers_of_iterations_never_touch_each_other(count):
    record = DimensionRecord(name="mu", unit="", low=0.0, high=1.0, scale="linear")
    drawn = figures.parameter(record, [[0.5] * count])
    labels = re.findall(r'<text x="([\d.]+)" y="176.0"[^>]*>([^<]+)</text>', drawn)
    places = [float(x) for x, _ in labels]
    assert labels[-1][1] == "next"
    assert labels[0][1] == "1"
    assert min(np.diff(places)) > 20.0
