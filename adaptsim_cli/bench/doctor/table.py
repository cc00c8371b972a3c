"""The doctor's checklist: each check has a group, a name, a condition, a probe and a remedy."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import Enum
from functools import cached_property, partial
from itertools import groupby

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from adaptsim_cli.bench.rig_file.description import RigDescription
from adaptsim_cli.bench.rig_file.reading import practised, rig_of, tasks_with_tools
from adaptsim_cli.config import Config, Resolved, same_lab
from adaptsim_cli.errors import CliError, PreflightFailed
from adaptsim_cli.screen import views
from adaptsim_cli.screen.pages import addressed
from adaptsim_cli.screen.reply import Reply
from calib.errors import CalibrationError
from hw.errors import CameraError, DeviceUnavailable, MotionRefused
from sim.errors import SimError

NO_ANSWER = (CliError, SimError, CalibrationError, CameraError, DeviceUnavailable, MotionRefused, OSError)
"""Errors of a probe that mean a missing part; any other one is a defect of the program."""


class Severity(Enum):
    """The severity of a finding; only MISSING prevents an iteration."""

    OK = "ok"
    ADVICE = "advice"  # works, not recommended
    MISSING = "missing"  # an iteration cannot run
    SKIPPED = "skipped"


@dataclass(frozen=True)
class Finding:
    """One line of the checklist. The table sets group and name, and the usual remedy."""

    verdict: Severity
    detail: str
    fix: str = ""  # the remedy, a command if there is one
    group: str = ""
    name: str = ""


ok, advice, missing, skipped = (partial(Finding, kind) for kind in Severity)


@dataclass
class Examined:
    """The lab of some settings, and the checks made so far."""

    resolved: Resolved
    findings: dict[str, Finding] = field(default_factory=dict)

    @property
    def config(self) -> Config:
        """The settings."""
        return self.resolved.config

    @cached_property
    def rig(self) -> RigDescription:
        """The rig of a real arm. Raises UsageError."""
        return rig_of(self.config, tasks_with_tools())

    def works(self, name: str) -> bool:
        """Whether this check was made, and nothing is missing."""
        return name in self.findings and self.findings[name].verdict in (Severity.OK, Severity.ADVICE)


Probe = Callable[[Examined], Finding]
When = Callable[[Examined], str]
"""The reason why a check is left out; empty if it is made."""


@dataclass(frozen=True)
class DoctorCheck:
    """One row of the table."""

    group: str
    name: str
    fix: str  # the remedy, unless the answer has its own; {hw} and {task} are those of the settings
    when: When
    probe: Probe

    def __call__(self, lab: Examined) -> Finding:
        """Make the check."""
        if why := self.when(lab):
            finding = skipped(why)
        else:
            try:
                finding = self.probe(lab)
            except NO_ANSWER as error:
                finding = missing(str(error))
        needs_remedy = finding.verdict in (Severity.ADVICE, Severity.MISSING)
        fix = finding.fix or self.fix.format(hw=lab.config.hw, task=lab.config.task)
        return replace(finding, fix=fix if needs_remedy else "", group=self.group, name=self.name)


def add_check(
    table: dict[str, DoctorCheck], group: str, name: str, fix: str = "", when: When = lambda lab: ""
) -> Callable[[Probe], None]:
    """Put the decorated probe into the table."""

    def add(probe: Probe) -> None:
        table[name] = DoctorCheck(group, name, fix, when, probe)

    return add


PROGRAM, MACHINE, DEVICES, TASK = "program", "machine", "devices", "task"
"""The groups of the checks."""


def real(lab: Examined) -> str:
    """The check is only for an arm that this program moves."""
    if lab.config.is_own:
        return "your robot belongs to your code"
    return "hw = fake needs none" if lab.config.is_simulated else ""


def described(lab: Examined) -> str:
    """The check needs a rig file, of a real arm or of a practised setup."""
    return "" if practised(lab.config) else with_rig(lab)


def with_rig(lab: Examined) -> str:
    """The check needs a readable rig file."""
    return real(lab) or ("" if lab.works("rig file") else "without a rig file the devices are unknown")


def after(name: str) -> When:
    """The check is made only if another one found nothing missing."""
    return lambda lab: with_rig(lab) or ("" if lab.works(name) else f"see {name}")


_MARKS = {Severity.OK: ("✓", "green"), Severity.ADVICE: ("!", "yellow"), Severity.MISSING: ("✗", "bold red")}


def checklist(findings: Sequence[Finding], config: Config) -> Iterator[RenderableType]:
    """Everything: the lab, the table, the remedies, and whether it is ready."""
    yield views.badge(config.hw, "simulated lab" if config.is_simulated else config.hw)
    yield from checks_table(findings)
    if not missing_in(findings):
        yield "\nReady"


def reply(findings: Sequence[Finding], config: Config) -> Reply:
    """The findings, and the next command if nothing is missing; otherwise the failure names the missing things."""
    rows = [{**asdict(finding), "verdict": finding.verdict.value} for finding in findings]
    names = missing_in(findings)
    data = {"ready": not names, "hw": config.hw, "task": config.task, "checks": rows}
    if names:
        failure = PreflightFailed(
            f'not ready: {", ".join(names)}. Each remedy is listed above, and under "fix" in --json'
        )
        return Reply(data, failure=failure)
    by = " --answer-with person" if config.is_own and not config.answer_with else ""
    first = (f"adaptsim run-iteration {same_lab(config.task, config.hw, config.world)}{by}", "the first trials")
    return Reply(data, next=[first])


def checks_table(results: Sequence[Finding], *, grouped: bool = True) -> Iterator[RenderableType]:
    """The table, then the checks that were left out, then each remedy on one unwrapped line that can be copied."""
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 1))
    table.add_column(width=1)
    table.add_column(min_width=17)
    table.add_column(overflow="fold")
    rows = [finding for finding in results if finding.verdict in _MARKS]
    for group, findings in groupby(rows, key=lambda finding: finding.group):
        if grouped:
            table.add_row("", Text(group, style="bold"), "")
        for finding in findings:
            table.add_row(Text(*_MARKS[finding.verdict]), finding.name, Text(finding.detail))
    yield table
    left_out = [finding for finding in results if finding.verdict not in _MARKS]
    for why in dict.fromkeys(finding.detail for finding in left_out):
        names = ", ".join(finding.name for finding in left_out if finding.detail == why)
        yield Text(f"– not checked: {names}; {why}", style="dim")
    for verdict, head in ((Severity.MISSING, "Missing:"), (Severity.ADVICE, "Recommended:")):
        remedies = [finding for finding in results if finding.verdict is verdict]
        if remedies:
            yield Text(f"\n{head}", style="bold")
        for finding in remedies:
            yield f"  {finding.name}: {addressed(finding.fix)}"


def missing_in(findings: Sequence[Finding]) -> list[str]:
    """The names of the failed checks."""
    return [finding.name for finding in findings if finding.verdict is Severity.MISSING]
