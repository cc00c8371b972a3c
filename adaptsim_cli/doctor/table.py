"""The table of the checklist: for each check its group, its name, when it is made, what it probes, and the remedy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property, partial

from adaptsim_cli.config import Config, Resolved
from adaptsim_cli.devices.rig_file.description import RigDescription
from adaptsim_cli.devices.rig_file.reading import practised, rig_of, tasks_with_tools
from adaptsim_cli.errors import CliError
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
    """The lab of some settings, and what was found so far."""

    resolved: Resolved
    found: dict[str, Finding] = field(default_factory=dict)

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
        return name in self.found and self.found[name].verdict in (Severity.OK, Severity.ADVICE)


Probe = Callable[[Examined], Finding]
When = Callable[[Examined], str]
"""Why a check is not made; empty: it is made."""


@dataclass(frozen=True)
class Check:
    """One row of the table."""

    group: str
    name: str
    fix: str  # the remedy, unless the answer has its own; {hw} and {task} are those of the settings
    when: When
    probe: Probe

    def __call__(self, lab: Examined) -> Finding:
        """Make the check."""
        if why := self.when(lab):
            found = skipped(why)
        else:
            try:
                found = self.probe(lab)
            except NO_ANSWER as error:
                found = missing(str(error))
        needs_remedy = found.verdict in (Severity.ADVICE, Severity.MISSING)
        fix = found.fix or self.fix.format(hw=lab.config.hw, task=lab.config.task)
        return replace(found, fix=fix if needs_remedy else "", group=self.group, name=self.name)


def add_check(
    table: dict[str, Check], group: str, name: str, fix: str = "", when: When = lambda lab: ""
) -> Callable[[Probe], None]:
    """Put the decorated probe into the table."""

    def add(probe: Probe) -> None:
        table[name] = Check(group, name, fix, when, probe)

    return add


def real(lab: Examined) -> str:
    """Only for a real arm."""
    return "hw = fake needs none" if lab.config.is_simulated else ""


def described(lab: Examined) -> str:
    """Only with a rig file: of a real arm, or of a setup that is practised."""
    return "" if practised(lab.config) else with_rig(lab)


def with_rig(lab: Examined) -> str:
    """Only with a readable rig file."""
    return real(lab) or ("" if lab.works("rig file") else "without a rig file the devices are unknown")


def after(name: str) -> When:
    """Only if another check found nothing missing."""
    return lambda lab: with_rig(lab) or ("" if lab.works(name) else f"see {name}")
