"""The trials of a session as table rows, for CSV, Parquet and comparisons. Pure, except that it reads the session."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence

from adaptsim_cli.session.records import Facts, TrialRecord
from adaptsim_cli.session.store import SessionStore

Cell = str | int | float
Row = dict[str, Cell]


def trials_of(store: SessionStore) -> tuple[TrialRecord, ...]:
    """Every completed trial that counts, in order. Raises SessionError."""
    return tuple(trial for i in range(store.iterations()) for trial in store.trials(i))


def rows(store: SessionStore) -> list[Row]:
    """One row for each trial that counts. Iterations, trials, attempts and particles are numbered from 1.

    A quantity's column is named `parameter_`, `context_` or `action_` plus its name; `units` gives its unit. Raises
    SessionError.
    """
    return [_row(store.facts, trial) for trial in trials_of(store)]


def units(store: SessionStore) -> dict[str, str]:
    """The unit of every column that has one. Rewards (0 to 1) have none."""
    facts = store.facts
    found = {
        f"{kind}_{d.name}": d.unit
        for kind, space in (("parameter", facts.parameters), ("context", facts.context), ("action", facts.action))
        for d in space
    }
    return {name: unit for name, unit in found.items() if unit} | {"duration_s": "s"}


def as_csv(table: Sequence[Mapping[str, Cell]]) -> str:
    """Rows as CSV, with the first row's columns and further ones of other rows."""
    text = io.StringIO()
    writer = csv.DictWriter(text, _columns(table), lineterminator="\n", restval="")
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()


def _columns(table: Iterable[Mapping[str, Cell]]) -> list[str]:
    return list(dict.fromkeys(name for row in table for name in row))


def _row(facts: Facts, trial: TrialRecord) -> Row:
    quantities = {"parameter": trial.parameters, "context": trial.context, "action": trial.action}
    return {
        **facts.named(),
        "started": trial.started,
        "iteration": trial.iteration,
        "trial": trial.trial,
        "attempt": trial.attempt,
        "particle": trial.particle,
        "outcome": trial.outcome.value,
        "overruled_from": trial.overruled_from.value if trial.overruled_from else "",
        "reward": trial.reward,
        "predicted_reward": trial.predicted_reward,
        "duration_s": trial.track.t_s[-1],
        **{f"{kind}_{name}": value for kind, point in quantities.items() for name, value in point.items()},
    }
