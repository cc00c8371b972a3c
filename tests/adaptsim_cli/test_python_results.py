"""What a session gives to Python programs: tables, plots, comparisons, progress, a notebook's view."""

from __future__ import annotations

import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from toy_session import NAME, run

import adaptsim
from adaptsim_cli.api import progress
from adaptsim_cli.api.beliefs import SessionPosterior
from adaptsim_cli.api.curves import LearningCurve
from adaptsim_cli.api.tables import Rows
from sim.adaptation.posterior import Posterior
from sim.tasks import get_task

PNG = b"\x89PNG"


@pytest.fixture
def belief() -> SessionPosterior:
    """A posterior around a known truth, in the pendulum's ranges."""
    task, rng = get_task("pendulum"), np.random.default_rng(0)
    samples, truth = task.margin.sample(rng, 400), task.parameters.middle
    away = np.linalg.norm(task.margin.normalise(samples) - task.margin.normalise(truth), axis=1)
    weights = np.exp(-0.5 * (away / 0.3) ** 2)
    even = Posterior(task.margin, samples, np.full(400, 1 / 400))
    return SessionPosterior(task.margin, samples, weights / weights.sum(), "study", 4, task.parameters, even, truth)


def test_tasks_and_worlds_are_rows_by_name() -> None:
    assert [row["task"] for row in adaptsim.tasks()][:3] == ["pendulum", "pushing", "scooping"]
    assert "mu" in str(adaptsim.tasks()[1]["parameters"])
    assert {"wd", "ood-1"} <= {str(row["world"]) for row in adaptsim.worlds("pendulum")}
    with pytest.raises(adaptsim.UnknownName, match="must be one of"):
        adaptsim.worlds("darts")


def test_a_pair_plot_has_every_pair_the_prior_and_the_truth(belief: SessionPosterior, tmp_path: Path) -> None:
    plot = belief.plot()
    shown = [ax for ax in plot.figure.axes if ax.get_visible()]
    assert len(shown) == 4 + 6, "four marginals, and each pair once"
    pair = next(ax for ax in shown if ax.get_xlabel().endswith("m1 [kg]"))
    drawn = {(line.get_marker(), np.size(line.get_xdata())) for line in pair.lines}
    assert {(".", 500), ("x", 1)} <= drawn
    assert plot.save(tmp_path / "new" / "pair.png").read_bytes().startswith(PNG)
    with pytest.raises(ValueError, match="Format 'doc' is not supported"):
        plot.save(tmp_path / "pair.doc")


def test_a_table_of_the_posterior_has_the_truth_beside_it(belief: SessionPosterior) -> None:
    assert "<th>truth</th>" in belief._repr_html_()
    frame = belief.to_pandas()
    assert list(frame.columns) == [*belief.space.names, "weight"]
    assert frame["weight"].sum() == pytest.approx(1.0)
    assert repr(belief).startswith(f"SessionPosterior({belief.session!r}: {belief.trials} trials, mean ")


def test_rows_become_a_data_frame_and_a_short_table() -> None:
    rows = Rows({"trial": n, "reward": n / 100} for n in range(40))
    frame = rows.to_pandas()
    assert (len(frame), list(frame.columns)) == (40, ["trial", "reward"])
    assert rows._repr_html_().count("<tr>") == 31 and "and 10 more rows" in rows._repr_html_()
    head, first, *_, rest = str(rows).splitlines()
    assert (head.split(), first.split(), rest) == (["trial", "reward"], ["0", "0"], "… and 10 more rows")
    assert len(str(rows).splitlines()) == 32


def test_a_printed_table_fits_a_line_and_names_what_it_leaves_out() -> None:
    rows = Rows([{f"quantity_{n}": 1 / 3 for n in range(20)} | {"note": 60 * "a"}])
    *lines, rest = str(rows).splitlines()
    assert max(map(len, lines)) <= 120 and lines[1].startswith("0.3333 ")
    assert rest == f"… and {21 - len(lines[0].split())} more columns"
    assert str(Rows([{"note": 60 * "a"}])).endswith("a…") and str(Rows()) == "no rows"


def test_a_learning_curve_draws_means_with_intervals_also_into_given_axes() -> None:
    row: dict[str, Any] = {"iteration": 1, "trials": 2, "mean_reward": 0.4, "low": 0.1, "high": 0.7}
    curve = LearningCurve("study", [row, row | {"iteration": 2, "trials": 4, "mean_reward": 0.9, "high": 1.0}])
    (ax,) = curve.plot().figure.axes
    drawn: Any = ax.containers[0]
    assert drawn.lines[0].get_xdata().tolist() == [2.0, 4.0]
    assert drawn.lines[0].get_ydata().tolist() == [0.4, 0.9]
    assert curve.plot(ax).figure is ax.figure and len(ax.containers) == 2


@pytest.mark.parametrize(("package", "extra"), [("matplotlib.figure", "plot"), ("pandas", "pandas")])
def test_a_missing_package_is_one_sentence(
    package: str, extra: str, belief: SessionPosterior, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(adaptsim.ExtraMissing, match=rf"needs the package .* not installed: .*\[{extra}\]"):
        belief.plot() if extra == "plot" else belief.to_pandas()


def test_sessions_are_compared_by_name_and_drawn_beside_each_other(place: Path) -> None:
    home = place.parent / "home"
    run(home, iterations=2)
    run(home, seed=1)
    compared = adaptsim.compare(NAME, f"{NAME}-seed1")
    assert [row["session"] for row in compared] == [NAME, f"{NAME}-seed1"]
    assert [len(curve) for curve in compared.curves] == [2, 1]
    assert compared.curves[0] == adaptsim.open_session(NAME).learning_curve()
    (ax,) = compared.plot().figure.axes
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [NAME, f"{NAME}-seed1"]
    assert "first_reward" in compared._repr_html_()
    shown = adaptsim.open_session(NAME)._repr_html_()
    assert "in the first iteration, " in shown and "data:image/svg+xml;base64," in shown
    assert adaptsim.open_session(NAME).verdict.split()[0] in shown


class _Notebook:
    """A kernel that keeps what is displayed: each `display` begins an output, `update` replaces it."""

    def __init__(self) -> None:
        self.outputs: list[str] = []
        self.kernel = self

    def display(self, shown: str, display_id: bool) -> types.SimpleNamespace:
        assert display_id
        self.outputs.append(shown)
        index = len(self.outputs) - 1

        def update(text: str) -> None:
            self.outputs[index] = text

        return types.SimpleNamespace(update=update)


def test_a_notebook_gets_one_bar_and_nothing_else(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    kernel = _Notebook()
    module: Any = types.ModuleType("IPython")
    module.get_ipython = lambda: kernel
    module.display = types.ModuleType("IPython.display")
    module.display.HTML, module.display.display = str, kernel.display
    monkeypatch.setitem(sys.modules, "IPython", module)
    monkeypatch.setitem(sys.modules, "IPython.display", module.display)
    with progress.one_bar("study", 2, 8) as bar:
        bar(3, "Rolling out <trial 4>")
        assert kernel.outputs == [
            '<progress value="3" max="8"></progress> study: 3 of 8 trials, Rolling out &lt;trial 4&gt;'
        ]
        bar(8, "")
    assert len(kernel.outputs) == 1 and 'value="8" max="8"' in kernel.outputs[0]
    screen = progress.silent()
    screen.note("careful")
    with screen.busy("Loading"):
        screen.plain("a line")
    assert capfd.readouterr() == ("", "") and len(kernel.outputs) == 1


@pytest.mark.long
def test_a_session_runs_until_its_verdict_says_stop_and_names_its_best_action(
    capfd: pytest.CaptureFixture[str],
) -> None:
    session = adaptsim.begin("pendulum", world="ood-1", name="study")
    assert session.run(3) is session
    assert capfd.readouterr() == ("", "")
    assert session.iterations[-1].verdict.stops or len(session.iterations) == 3
    best = session.best()
    assert list(best.action.values()) == pytest.approx(session.best_policy()(np.zeros(0)).tolist())
    assert best.interval[0] <= best.reward <= best.interval[1]
    assert best.units["m1"] == "kg"
    belief = session.posterior()
    assert belief.trials == len(session.trials) and belief.truth is not None and belief.truth[1] == 0.3
    assert session.posterior(0).trials == 0 and session.posterior(0).prior.effective > belief.effective
    assert len(session.to_pandas()) == len(session.trials)
