"""Writes a benchmark as one HTML page, with its rows as CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from adaptsim_cli.research import benchmark_figures as figures
from adaptsim_cli.research.benchmark_tables import cells, title
from adaptsim_cli.storage import durable
from sim.research.benchmark.jobs import LIMITS, UDR, Row
from sim.research.benchmark.sessions import UDR_POLICIES
from sim.research.benchmark.summary import LEAST_GAP, WORSE_BY, MethodSummary, SetSummary

PAGE, TABLE, DATA = "report.html", "rows.csv", "benchmark.json"
COLUMNS = ("task", "set", "target", "method", "seed", "reward", "ci95_low", "ci95_high", "real_trials", "simulations")
"""Columns of the CSV, before `wall_s`."""


@dataclass(frozen=True)
class SetView:
    """One set of worlds for the page."""

    title: str
    rows: tuple[tuple[str, ...], ...]
    differences: str  # SVG; empty if UDR was not run
    curves: tuple[tuple[str, str], ...]  # (method, SVG)
    with_gap: str  # names; empty if there are none, or they are unknown


@dataclass(frozen=True, eq=False)
class Comparison:
    """A comparison and its results."""

    folder: Path
    task_title: str
    plan: Mapping[str, Any]  # task, conditions, checkpoints
    targets: tuple[str, ...]
    seeds: int
    tabled: bool  # whether trials were looked up in world tables
    left_out: tuple[tuple[str, str], ...]  # methods missing from these checkpoints, and why
    rows: tuple[Row, ...]
    summaries: tuple[SetSummary, ...]

    def as_json(self) -> dict[str, Any]:
        """The whole comparison, with one row per world, method and seed."""
        return {
            "trials": "tables" if self.tabled else "simulated",
            **self.plan,
            "targets": list(self.targets),
            "seeds": self.seeds,
            "left_out": dict(self.left_out),
            "rows": [asdict(row) for row in self.rows],
            "summary": [asdict(summary) for summary in self.summaries],
            "report": str(self.folder / PAGE),
        }


def write(found: Comparison) -> Path:
    """Write page, CSV and JSON into the folder and return the path of the page. Raises SessionError."""
    content = json.dumps(found.as_json(), allow_nan=False, indent=1) + "\n"
    durable.replace_file(found.folder / TABLE, table(found).encode())
    durable.replace_file(found.folder / DATA, content.encode())
    durable.replace_file(found.folder / PAGE, render(found).encode())
    return found.folder / PAGE


def table(found: Comparison) -> str:
    """The rows as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*COLUMNS, "wall_s"])
    for row in found.rows:
        start = [row.task, row.set, row.target, row.method, row.seed, row.reward]
        writer.writerow([*start, *row.ci95, row.real_trials, row.simulations, round(row.wall_s, 3)])
    return text.getvalue()


def render(found: Comparison) -> str:
    """The page as HTML."""
    from jinja2 import Environment, StrictUndefined

    folder, shared = resources.files("adaptsim_cli.research"), resources.files("adaptsim_cli.report")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string((folder / "benchmark.html.j2").read_text(encoding="utf-8"))
    return template.render(
        found=found,
        conditions=found.plan["conditions"],
        style=(shared / "style.css").read_text(encoding="utf-8"),
        sets=[_view(summary) for summary in found.summaries],
        least_gap=LEAST_GAP,
        worse_by=WORSE_BY,
        udr_policies=UDR_POLICIES,
    )


def _view(summary: SetSummary) -> SetView:
    known = {method.method: method for method in summary.methods}
    levels = {name: known[name].reward for name in (UDR, *LIMITS) if name in known}
    sessions: list[MethodSummary] = [m for m in summary.methods if m.method not in levels]
    compared = [m for m in summary.methods if m.above_udr is not None and m.method != UDR]
    return SetView(
        title=title(summary),
        rows=tuple(cells(method) for method in summary.methods),
        differences=figures.differences(compared) if compared else "",
        curves=tuple((method.method, figures.curve(method, levels)) for method in sessions),
        with_gap=", ".join(summary.with_gap or ()),
    )
