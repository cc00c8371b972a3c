"""The checklist for the screen and for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

from rich.table import Table
from rich.text import Text

from adaptsim_cli.config import Config, same_lab
from adaptsim_cli.doctor.finding import Finding, Severity
from adaptsim_cli.errors import PreflightFailed
from adaptsim_cli.screen import views
from adaptsim_cli.screen.console import Screen

_MARKS = {
    Severity.OK: ("✓", "green"),
    Severity.ADVICE: ("!", "yellow"),
    Severity.MISSING: ("✗", "bold red"),
    Severity.SKIPPED: ("–", "dim"),
}


def show(found: Sequence[Finding], config: Config, screen: Screen) -> None:
    """Show the table, then each remedy on an unwrapped line, so that it can be copied."""
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 1))
    table.add_column(width=1)
    table.add_column(min_width=17)
    table.add_column(overflow="fold")
    for group, findings in groupby(found, key=lambda finding: finding.group):
        table.add_row("", Text(group, style="bold"), "")
        for finding in findings:
            table.add_row(Text(*_MARKS[finding.verdict]), finding.name, Text(finding.detail, style=_style(finding)))
    screen.show(views.badge(config.hw, "simulated lab" if config.is_simulated else config.hw))
    screen.show(table)
    for verdict, head in ((Severity.MISSING, "Missing:"), (Severity.ADVICE, "Recommended:")):
        remedies = [finding for finding in found if finding.verdict is verdict]
        if remedies:
            screen.show(Text(f"\n{head}", style="bold"))
        for finding in remedies:
            screen.plain(f"  {finding.name}: {finding.fix}")
    if not _missing(found):
        screen.plain("\nReady")
        screen.next((f"adaptsim run-iteration {same_lab(config.task, config.hw, config.world)}", "the first trials"))


def as_json(found: Sequence[Finding], config: Config) -> dict[str, Any]:
    """The checklist for `doctor --json`."""
    checks = [
        {"group": f.group, "name": f.name, "verdict": f.verdict.value, "detail": f.detail, "fix": f.fix} for f in found
    ]
    return {"ready": not _missing(found), "hw": config.hw, "task": config.task, "checks": checks}


def require(found: Sequence[Finding]) -> None:
    """Raises PreflightFailed naming what is missing."""
    if names := _missing(found):
        raise PreflightFailed(f'not ready: {", ".join(names)}. Each remedy is listed above, and under "fix" in --json')


def _missing(found: Sequence[Finding]) -> list[str]:
    return [finding.name for finding in found if finding.verdict is Severity.MISSING]


def _style(finding: Finding) -> str:
    return "dim" if finding.verdict is Severity.SKIPPED else ""
