"""The whole checklist: made, shown, and required."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import asdict
from itertools import groupby
from typing import Any

from rich.table import Table
from rich.text import Text

from adaptsim_cli.config import Config, Resolved, same_lab
from adaptsim_cli.doctor.checks import CHECKS
from adaptsim_cli.doctor.table import Examined, Finding, Severity
from adaptsim_cli.errors import PreflightFailed
from adaptsim_cli.screen import views
from adaptsim_cli.screen.console import Screen


def examine(resolved: Resolved, names: Collection[str] = tuple(CHECKS)) -> Iterator[Finding]:
    """Check everything that an iteration with these settings needs, or only the named checks.

    A missing part is a finding, never an error.
    """
    lab = Examined(resolved)
    for name in names:
        lab.found[name] = CHECKS[name](lab)
        yield lab.found[name]


_MARKS = {Severity.OK: ("✓", "green"), Severity.ADVICE: ("!", "yellow"), Severity.MISSING: ("✗", "bold red")}


def show(found: Sequence[Finding], config: Config, screen: Screen) -> None:
    """Show everything, and the next command if nothing is missing."""
    screen.show(views.badge(config.hw, "simulated lab" if config.is_simulated else config.hw))
    show_table(found, screen)
    if not missing_in(found):
        screen.plain("\nReady")
        screen.next((f"adaptsim run-iteration {same_lab(config.task, config.hw, config.world)}", "the first trials"))


def show_table(found: Sequence[Finding], screen: Screen, *, grouped: bool = True) -> None:
    """Show the table, the checks left out, then each remedy on a line that is not wrapped, to be copied."""
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 1))
    table.add_column(width=1)
    table.add_column(min_width=17)
    table.add_column(overflow="fold")
    made = [finding for finding in found if finding.verdict in _MARKS]
    for group, findings in groupby(made, key=lambda finding: finding.group):
        if grouped:
            table.add_row("", Text(group, style="bold"), "")
        for finding in findings:
            table.add_row(Text(*_MARKS[finding.verdict]), finding.name, Text(finding.detail))
    screen.show(table)
    left_out = [finding for finding in found if finding.verdict not in _MARKS]
    for why in dict.fromkeys(finding.detail for finding in left_out):
        names = ", ".join(finding.name for finding in left_out if finding.detail == why)
        screen.show(Text(f"– not checked: {names}; {why}", style="dim"))
    for verdict, head in ((Severity.MISSING, "Missing:"), (Severity.ADVICE, "Recommended:")):
        remedies = [finding for finding in found if finding.verdict is verdict]
        if remedies:
            screen.show(Text(f"\n{head}", style="bold"))
        for finding in remedies:
            screen.plain(f"  {finding.name}: {finding.fix}")


def as_json(found: Sequence[Finding], config: Config) -> dict[str, Any]:
    """The checklist for `doctor --json`."""
    told = [{**asdict(finding), "verdict": finding.verdict.value} for finding in found]
    return {"ready": not missing_in(found), "hw": config.hw, "task": config.task, "checks": told}


def require(found: Sequence[Finding]) -> None:
    """Raises PreflightFailed naming what is missing."""
    if names := missing_in(found):
        raise PreflightFailed(f'not ready: {", ".join(names)}. Each remedy is listed above, and under "fix" in --json')


def missing_in(found: Sequence[Finding]) -> list[str]:
    """The names of the failed checks."""
    return [finding.name for finding in found if finding.verdict is Severity.MISSING]
