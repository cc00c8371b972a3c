"""The learning curve of a session, and several sessions beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from adaptsim_cli.api.tables import Plot, Rows, empty_figure
from adaptsim_cli.screen.outputs.sessions import ParameterBelief
from adaptsim_cli.session.exporting import Row
from adaptsim_cli.session.history import trials_of
from adaptsim_cli.session.judgement import MeanReward, iteration_means
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show.comparison import ComparedSession, disagreements


class LearningCurve(Rows):
    """A row for each complete iteration: the number of trials so far, the mean reward of this iteration's trials, and
    its 95 % interval.
    """

    def __init__(self, session: str, rows: Sequence[Row]) -> None:
        super().__init__(rows)
        self.session = session

    def plot(self, axes: Any = None) -> Plot:
        """Plot the mean reward against trials, with intervals, into matplotlib's `axes`; without them, into a new
        figure.

        Raises ExtraMissing without matplotlib.
        """
        return _drawn([self], axes)


class SessionComparison(Rows):
    """Two or more sessions, with a row for each: the mean rewards of its first and its last iteration."""

    def __init__(self, sessions: Sequence[ComparedSession], beliefs: Sequence[ParameterBelief]) -> None:
        super().__init__(one.as_row() for one in sessions)
        self.curves = tuple(LearningCurve(one.facts.name, _rows(one.iterations)) for one in sessions)
        self.disagreements = disagreements(beliefs)  # sentences: in which parameters the posteriors disagree

    def plot(self, axes: Any = None) -> Plot:
        """The learning curves of all sessions. Raises ExtraMissing without matplotlib."""
        return _drawn(self.curves, axes)

    def __repr__(self) -> str:
        return "\n".join([repr(self._short()), *self.disagreements])

    def _repr_html_(self) -> str:
        return self._short()._repr_html_() + "".join(f"<p>{sentence}</p>" for sentence in self.disagreements)

    def _short(self) -> Rows:
        names = ("session", "method", "world", "seed", "trials", "first_reward", "last_reward", "last_low", "last_high")
        return Rows({name: row[name] for name in names} for row in self)


def curve_of(store: SessionStore) -> LearningCurve:
    """The learning curve of a stored session. Raises SessionError."""
    return LearningCurve(store.facts.name, _rows(iteration_means(store.facts, trials_of(store))))


def _rows(means: Sequence[MeanReward]) -> list[Row]:
    """The rows of a curve from the mean of each iteration, in order."""
    rows, so_far = list[Row](), 0
    for number, mean in enumerate(means, start=1):
        so_far += mean.trials
        row: Row = {"iteration": number, "trials": so_far, "mean_reward": mean.mean, "low": mean.low, "high": mean.high}
        rows.append(row)
    return rows


def _drawn(curves: Sequence[LearningCurve], axes: Any) -> Plot:
    figure = empty_figure(6.4, 4.0) if axes is None else axes.figure
    ax = figure.subplots() if axes is None else axes
    shift = 0.12 if len(curves) > 1 else 0.0  # so that intervals at the same trial do not hide each other
    for index, curve in enumerate(curves):
        trials = [float(row["trials"]) + shift * (index - (len(curves) - 1) / 2) for row in curve]
        means = [float(row["mean_reward"]) for row in curve]
        below = [float(row["mean_reward"]) - float(row["low"]) for row in curve]
        above = [float(row["high"]) - float(row["mean_reward"]) for row in curve]
        ax.errorbar(trials, means, (below, above), fmt="o-", capsize=3, label=curve.session)
    ax.set_xlim(left=0.0)
    ax.locator_params(axis="x", integer=True)
    ax.set_ylim(-0.02, 1.02)
    ax.set_xlabel("trials so far")
    ax.set_ylabel("mean reward of an iteration, 95 % interval")
    ax.grid(alpha=0.3)
    ax.legend()
    return Plot(figure)
