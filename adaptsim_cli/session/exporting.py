"""The trials of a session as a table. Formats: `adaptsim_cli.session.formats`."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from adaptsim_cli.session.history import played_of
from adaptsim_cli.session.records import SessionFacts, TrialRecord
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.storage import durable

Cell = str | int | float
Row = dict[str, Cell]


def written(path: Path, content: bytes) -> Path:
    """Write or replace one file, in a folder that may be new, and return its path."""
    durable.make_folder(path.absolute().parent)
    durable.replace_file(path.absolute(), content)
    return path


def rows(store: SessionStore) -> list[Row]:
    """One row for each trial that counts. Iterations, trials, attempts and particles are numbered from 1.

    A quantity's column is named `parameter_`, `context_` or `action_` plus its name; `units` gives its unit. A category
    has its word. `ended` is the end in the task's own words, if it has some. Raises SessionError.
    """
    return [_row(store.facts, trial) for trial in played_of(store)]


def units(store: SessionStore) -> dict[str, str]:
    """The unit of every column that has one. Rewards (0 to 1) have none."""
    facts = store.facts
    by_name = {
        f"{kind}_{d.name}": d.unit
        for kind, space in (("parameter", facts.parameters), ("context", facts.context), ("action", facts.action))
        for d in space
    }
    return {name: unit for name, unit in by_name.items() if unit} | {"duration_s": "s"}


def as_csv(table: Sequence[Mapping[str, Cell]]) -> str:
    """Rows as CSV. The columns are those of the first row, then further ones that other rows have."""
    text = io.StringIO()
    columns = dict.fromkeys(name for row in table for name in row)
    writer = csv.DictWriter(text, list(columns), lineterminator="\n", restval="")
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()


def _row(facts: SessionFacts, trial: TrialRecord) -> Row:
    spaces = {"parameter": facts.parameters, "context": facts.context, "action": facts.action}
    points = {"parameter": trial.parameters, "context": trial.context, "action": trial.action}
    words = {(kind, d.name): d.words for kind, space in spaces.items() for d in space if d.words}

    def cell(kind: str, name: str, value: float) -> Cell:
        return words[kind, name][round(value)] if (kind, name) in words else value

    return {
        **facts.named(),
        "started": trial.started,
        "iteration": trial.iteration,
        "trial": trial.trial,
        "attempt": trial.attempt,
        "particle": trial.particle,
        "role": trial.role.value,
        "outcome": trial.outcome.value,
        "overruled_from": trial.overruled_from.value if trial.overruled_from else "",
        "reward": trial.reward,
        "predicted_reward": trial.predicted_reward,
        "duration_s": trial.track.t_s[-1],
        **({"ended": trial.ended} if trial.ended else {}),
        **{f"{kind}_{name}": cell(kind, name, v) for kind, point in points.items() for name, v in point.items()},
    }
