"""The posterior of a session's parameters, with the prior that it began with and, in a simulated world, the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptsim_cli.api.tables import Plot, data_frame, empty_figure, html_table
from adaptsim_cli.config import is_simulated
from adaptsim_cli.screen.views import chances_in_words, values
from adaptsim_cli.session.hindsight import Hindsight
from adaptsim_cli.session.store import SessionStore
from hw.types import Array
from sim.adaptation.posterior import COLLAPSED, Posterior
from sim.errors import SimError
from sim.types import Dimension, Space

if TYPE_CHECKING:
    from pandas import DataFrame

DRAWN = 500
"""Number of parameter vectors that a plot shows."""
BINS = 24


@dataclass(frozen=True, eq=False, repr=False)
class SessionPosterior(Posterior):
    """`Posterior` of a session: the probability of each parameter vector, given the trajectories."""

    session: str
    trials: int  # counting trials behind it
    ranges: Space  # the trained ranges of the parameters; `space` has the margin around them
    prior: Posterior  # before the first trial
    truth: Array | None  # (p,) in units, of a simulated world; None: unknown

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.session!r}: {self.trials} trials, mean {values(self.space, self.mean)})"

    def plot(self) -> Plot:
        """A pair plot of the posterior, with the prior in grey and, in a simulated world, the truth as a cross.

        Axes span the margin; dotted lines are the ends of the trained ranges. Raises ExtraMissing without matplotlib.
        """
        p, dimensions = len(self.space), self.space.dimensions
        figure = empty_figure(1.2 + 2.1 * p, 1.0 + 1.9 * p, None)  # "constrained" takes seconds for so many axes
        figure.subplots_adjust(left=0.11, bottom=0.09, right=0.98, top=0.93, wspace=0.1, hspace=0.1)
        axes = figure.subplots(p, p, squeeze=False)
        drawn, before = self.draw(DRAWN), self.prior.draw(DRAWN)
        for row in range(p):
            for column in range(p):
                ax = axes[row, column]
                if column > row:
                    ax.set_visible(False)
                    continue
                _scaled(ax, "x", dimensions[column], self.ranges.dimensions[column])
                if row == column:
                    self._marginal(ax, column)
                else:
                    _scaled(ax, "y", dimensions[row], self.ranges.dimensions[row])
                    ax.plot(before[:, column], before[:, row], ".", color="0.8", ms=2)
                    ax.plot(drawn[:, column], drawn[:, row], ".", color="C0", ms=4, alpha=0.35)
                    if self.truth is not None:
                        ax.plot(self.truth[column], self.truth[row], "x", color="C3", ms=9, mew=2, clip_on=False)
                if row == p - 1:
                    ax.set_xlabel(_title(dimensions[column]))
                else:
                    ax.tick_params(labelbottom=False)
                if column == 0 and row > 0:
                    ax.set_ylabel(_title(dimensions[row]))
                elif row != column:
                    ax.tick_params(labelleft=False)
        truth = "" if self.truth is None else ", red: truth of the simulated world"
        warning = f"\nthe posterior is {COLLAPSED}" if self.is_collapsed else ""
        figure.suptitle(
            f"{self.session}, {self.trials} trials (blue: posterior, grey: prior{truth}){warning}", fontsize=10
        )
        return Plot(figure)

    def to_pandas(self) -> DataFrame:
        """The parameter vectors with their weights, one row for each vector. Raises ExtraMissing without pandas."""
        return data_frame({**self.space.columns(self.samples), "weight": self.weights})

    def _marginal(self, ax: Any, k: int) -> None:
        d = self.space.dimensions[k]
        ends = self.space.denormalise(np.linspace(0.0, 1.0, BINS + 1)[:, None] * np.ones(len(self.space)))[:, k]
        edges = np.arange(d.low - 0.5, d.high + 1.0) if d.scale == "integer" else ends
        ax.hist(self.prior.samples[:, k], edges, weights=self.prior.weights, histtype="step", color="0.6")
        ax.hist(self.samples[:, k], edges, weights=self.weights, color="C0", alpha=0.7)
        if self.truth is not None:
            ax.axvline(self.truth[k], color="C3", lw=2)
        ax.set_yticks([])

    def _repr_html_(self) -> str:
        head = ["parameter", "unit", "mean", "5 %", "median", "95 %"]
        if self.is_collapsed:
            return f"<p>The posterior of {self.session} is {COLLAPSED} ({self.effective:.1f} effective samples).</p>"
        body = [self._in_words(index, row) for index, row in enumerate(self.table())]
        if self.truth is not None:
            head.append("truth")
            pairs = zip(self.space.dimensions, self.truth, strict=True)
            truths = [d.kinds[round(value)] if d.kinds else float(value) for d, value in pairs]
            body = [[*row, truth] for row, truth in zip(body, truths, strict=True)]
        return f"<p>{self.session}: posterior after {self.trials} trials</p>{html_table(head, body)}"

    def _in_words(self, index: int, row: dict[str, str | float]) -> list[str | float]:
        """A row of the table. For a category it has the probability of each word instead of a mean."""
        chances, kinds = self.chances(index), self.space.dimensions[index].kinds
        if chances is None:
            return list(row.values())
        return [row["parameter"], "", chances_in_words(kinds, chances), *([""] * (len(row) - 3))]


def posterior_of(store: SessionStore, hindsight: Hindsight, iterations: int | None) -> SessionPosterior:
    """The posterior after `iterations` iterations. Raises CheckpointError, SessionError."""
    after, begun = hindsight.posterior(store, iterations), store.iterations() if iterations is None else iterations
    count = sum(len(store.trials(i)) for i in range(min(begun, store.iterations())))
    prior = after if count == 0 else hindsight.posterior(store, 0)
    ranges, truth = hindsight.checkpoint.solver.task.parameters, truth_of(store, hindsight)
    return SessionPosterior(after.space, after.samples, after.weights, store.facts.name, count, ranges, prior, truth)


def truth_of(store: SessionStore, hindsight: Hindsight) -> Array | None:
    """(p,) the true parameters of a session in a simulated world; None for any other, or if its world is gone."""
    from sim.lab.world import load_world

    facts = store.facts
    if not is_simulated(facts.hw) or facts.recorded:
        return None
    try:
        return load_world(facts.world, hindsight.checkpoint.solver.task).parameters
    except SimError:
        return None


def _title(d: Dimension) -> str:
    """Plain name, and below it name and unit."""
    return d.label if d.plain_name == d.name else f"{d.title.removesuffix(d.label).strip()}\n{d.label}"


def _scaled(ax: Any, axis: str, d: Dimension, trained: Dimension) -> None:
    """Limits, scale and ticks of one parameter; dotted lines at the ends of its trained range."""
    low, high = d.low, d.high
    if d.scale == "integer":
        low, high = low - 0.5, high + 0.5
    if d.scale == "log":
        getattr(ax, f"set_{axis}scale")("log")
    getattr(ax, f"set_{axis}lim")(low, high)
    for end in (trained.low, trained.high):
        if d.low < end < d.high:
            (ax.axvline if axis == "x" else ax.axhline)(end, color="0.6", lw=0.8, ls=":")
    if d.kinds:
        getattr(ax, f"set_{axis}ticks")(range(len(d.kinds)), d.kinds)
