"""The tables of a benchmark on the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.table import Table

from sim.research.benchmark.summary import Interval, MethodSummary, SetSummary

MINUS = "\N{MINUS SIGN}"


def tables(summaries: Sequence[SetSummary]) -> Iterator[Table]:
    """One for each set of worlds."""
    for summary in summaries:
        table = Table(title=title(summary), title_justify="left", box=None)
        table.add_column("method", no_wrap=True)
        for heading in ("reward", "above udr", "95 %", "gap closed", "worse"):
            table.add_column(heading, justify="right", no_wrap=True)
        for method in summary.methods:
            name, reward, _, above, interval, closed, worse, _ = cells(method)
            table.add_row(name, reward, above, interval, closed, worse)
        yield table


def title(summary: SetSummary) -> str:
    """The heading of a set: the basis of its numbers."""
    gap = "" if summary.with_gap is None else f", {len(summary.with_gap)} with a gap between oracle and udr"
    worlds, seeds = _count(summary.worlds, "world"), _count(summary.seeds, "seed")
    return f"{summary.set}: {worlds}, {seeds}{gap}"


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
    return "" if value is None else f"{value:+.3f}".replace("-", MINUS)


def between(interval: Interval | None) -> str:
    """Both ends of an interval; empty if unknown."""
    return "" if interval is None else f"{interval[0]:.3f} to {interval[1]:.3f}".replace("-", MINUS)


def _count(n: int, what: str) -> str:
    return f"{n} {what}{'s' if n != 1 else ''}"
