"""Writes a benchmark as one HTML page, with its rows as CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from rich.console import RenderableType
from rich.text import Text

from adaptsim_cli.research.benchmarking import PAGE, Comparison
from adaptsim_cli.screen import views
from adaptsim_cli.screen.svg import Canvas, Scale
from adaptsim_cli.storage import durable
from sim.adaptation.methods.udr import DRAWS
from sim.research.benchmark.entries import UDR
from sim.research.benchmark.strata import NEED, SealedSummary
from sim.research.benchmark.summary import LEAST_GAP, WORSE_BY, Interval, MethodSummary, SetSummary

TABLE, DATA = "rows.csv", "benchmark.json"
COLUMNS = ("task", "set", "target", "method", "seed", "reward", "ci95_low", "ci95_high", "real_trials", "simulations")
"""Columns of the CSV, before `wall_s`."""


def write(comparison: Comparison) -> Path:
    """Write page, CSV and JSON into the folder and return the path of the page. Raises SessionError."""
    folder, content = comparison.request.folder, json.dumps(comparison.as_json(), allow_nan=False, indent=1) + "\n"
    durable.replace_file(folder / TABLE, table(comparison).encode())
    durable.replace_file(folder / DATA, content.encode())
    durable.replace_file(folder / PAGE, render(comparison).encode())
    return folder / PAGE


def table(comparison: Comparison) -> str:
    """The rows as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*COLUMNS, "wall_s"])
    for row in comparison.rows:
        start = [row.task, row.set, row.target, row.method, row.seed, row.reward]
        writer.writerow([*start, *row.ci95, row.real_trials, row.simulations, round(row.wall_s, 3)])
    return text.getvalue()


def render(comparison: Comparison) -> str:
    """The page as HTML."""
    from jinja2 import Environment, StrictUndefined

    folder, shared = resources.files("adaptsim_cli.research"), resources.files("adaptsim_cli.screen")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string((folder / "benchmark.html.j2").read_text(encoding="utf-8"))
    return template.render(
        comparison=comparison,
        plan=comparison.request.plan,
        style=(shared / "style.css").read_text(encoding="utf-8"),
        sets=[_view(summary) for summary in comparison.summaries],
        least_gap=LEAST_GAP,
        worse_by=WORSE_BY,
        udr_policies=DRAWS,
    )


def _view(summary: SetSummary) -> dict[str, Any]:
    """A set for the template; `differences` is empty if UDR was not run."""
    levels = {method.method: method.reward for method in summary.methods if not method.trials[-1]}
    compared = [m for m in summary.methods if m.above_udr is not None and m.method != UDR]
    return {
        "title": title(summary),
        "rows": [cells(method) for method in summary.methods],
        "differences": differences(compared) if compared else "",
        "curves": [(m.method, curve(m, levels)) for m in summary.methods if m.method not in levels],
        "with_gap": ", ".join(summary.with_gap or ()),
    }


def curve(method: MethodSummary, levels: Mapping[str, float]) -> str:
    """Mean reward against real trials, with its interval; `levels` are the rewards of references that need no trials,
    drawn as lines.
    """
    canvas = Canvas(360, 200, f"Reward of {method.method} against trials")
    left, right, top, bottom = 38.0, 350.0, 12.0, 166.0
    x, y = Scale(0.0, float(method.trials[-1]), left, right), Scale(0.0, 1.0, bottom, top)
    canvas.rewards(left, right, y)
    for name, reward in levels.items():
        canvas.line(left, y(reward), right, y(reward), "area")
        canvas.text(right, y(reward) - 4, name, anchor="end")
    points = [(x(float(n)), y(reward)) for n, reward in zip(method.trials, method.curve, strict=True)]
    for (at, _), (low, high) in zip(points, method.curve_ci95, strict=True):
        canvas.rect(at - 8, y(high), 16, max(y(low) - y(high), 1.0), "expected c0", 2)  # wider than the dot
    canvas.curve(points, "curve c0", method.method)
    for (at, height), n, reward in zip(points, method.trials, method.curve, strict=True):
        canvas.dot(at, height, 4, "dot c0", f"{n} trials: {reward:.3f}")
        canvas.text(at, bottom + 16, str(n), anchor="middle")
    return canvas.svg()


def differences(methods: Sequence[MethodSummary]) -> str:
    """Mean paired difference of each method to UDR, with its interval. A method far below has only its number."""
    candidates = [(m, m.above_udr, m.above_udr_ci95) for m in methods]
    rows = [(m, mean, ci) for m, mean, ci in candidates if mean is not None and ci is not None]
    height = 26.0 * len(rows)
    canvas = Canvas(760, height + 40.0, "Difference of every method to UDR, paired by world, seed and contexts")
    ends = [end for _, _, ci in rows for end in ci]
    x = Scale(max(FAR_BELOW, min(-0.05, *ends)), max(0.05, *ends), 170.0, 740.0)
    for tick in x.ticks(7):
        canvas.line(x(tick), 4.0, x(tick), height + 8.0, "mean" if abs(tick) < 1e-9 else "grid")
        canvas.text(x(tick), height + 26.0, signed_tick(tick) if tick else "0", anchor="middle")
    for i, (method, mean, (low, high)) in enumerate(rows):
        middle = 20.0 + 26.0 * i
        canvas.text(160.0, middle + 4.0, method.method, anchor="end")
        if mean < x.low:
            canvas.text(x.start + 4.0, middle + 4.0, f"{signed(mean)}, far below", "row")
            continue
        left = x(max(low, x.low))
        canvas.rect(left, middle - 5.0, max(x(high) - left, 1.5), 10.0, "expected c0", 3)
        canvas.dot(x(mean), middle, 4.5, "dot c0", f"{signed(mean)} ({views.between(low, high, '+.3f')})")
    return canvas.svg()


FAR_BELOW = -0.25
"""The lowest difference to UDR that its figure draws, so that one method does not squash the others."""
MINUS = "\N{MINUS SIGN}"


def tables(summaries: Sequence[SetSummary]) -> Iterator[RenderableType]:
    """One for each set of worlds."""
    head = ("method", "reward", "above udr", "95 %", "gap closed", "worse")
    for summary in summaries:
        rows = map(cells, summary.methods)
        body = [(method, reward, *rest) for method, reward, _, *rest, _ in rows]
        yield Text(title(summary), style="italic")
        yield views.rows(head, body, right=range(1, 6), whole=(0, 3))


def strata_tables(summary: SealedSummary | None) -> Iterator[RenderableType]:
    """One for each stratum of sealed worlds: every entry beside `adaptsim`, paired by world."""
    if summary is None:
        return
    head = ("entry", "reward", "95 %", "adaptsim minus it", "95 %")
    for name in dict.fromkeys(one.stratum for one in summary.strata):
        rows = [one for one in summary.strata if one.stratum == name]
        heading = f"sealed, {name}: {_count(rows[0].worlds, 'world')}"
        body = [
            (one.entry, f"{one.reward:.3f}", between(one.ci95), signed(one.behind), between(one.behind_ci95))
            for one in sorted(rows, key=lambda one: -one.reward)
        ]
        yield Text(heading, style="italic")
        yield views.rows(head, body, right=range(1, 5), whole=(0, 2, 4))
    need = f"; a world in need has an action worth {NEED:g} more" if summary.worth else ""
    yield Text(f"The best fixed rule is {summary.fixed_rule}{need}.")


def title(summary: SetSummary) -> str:
    """The heading of a set, which states the basis of its numbers."""
    gap = "" if summary.with_gap is None else f", {len(summary.with_gap)} with a gap between oracle and udr"
    worlds, seeds = _count(summary.worlds, "world"), _count(summary.seeds, "seed")
    again = ", ".join(m.method for m in summary.methods if m.same_for_every_seed)
    return f"{summary.set}: {worlds}, {seeds}{gap}" + (f"; every seed gave {again} the same sessions" if again else "")


def cells(method: MethodSummary) -> tuple[str, ...]:
    """A row as text; unknown values stay empty."""
    worst = "" if method.worst_world is None else f"{method.worst_world} {signed(method.worst_difference)}"
    return (
        method.method,
        f"{method.reward:.3f}",
        between(method.ci95),
        signed(method.above_udr),
        between(method.above_udr_ci95),
        "" if method.gap_closed is None else f"{method.gap_closed:.2f}".replace("-", MINUS),
        "" if method.worse_worlds is None else str(method.worse_worlds),
        worst,
    )


def signed(value: float | None) -> str:
    """A number with its sign; empty if unknown."""
    return "" if value is None else views.signed(value, 3)


def signed_tick(value: float) -> str:
    """The label of a tick: as many decimals as it needs, two at least."""
    return f"{value:+.3f}".removesuffix("0").replace("-", MINUS)


def between(interval: Interval | None) -> str:
    """The two ends of an interval; empty if unknown, `–` without a width, as for a single session."""
    return "" if interval is None else views.between(*interval, ".3f")


def _count(n: int, what: str) -> str:
    return f"{n} {what}{'s' if n != 1 else ''}"
