"""What one check found."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Severity(Enum):
    """How bad a finding is: MISSING alone keeps an iteration from running."""

    OK = "ok"
    ADVICE = "advice"  # it works, but better not like this
    MISSING = "missing"  # an iteration cannot run
    SKIPPED = "skipped"


@dataclass(frozen=True)
class Finding:
    """One line of the checklist. `fix` says what mends it, as a command where there is one."""

    group: str
    name: str
    verdict: Severity
    detail: str
    fix: str = ""


def ok(group: str, name: str, detail: str) -> Finding:
    """All is well; nothing to mend."""
    return Finding(group, name, Severity.OK, detail)


def advice(group: str, name: str, detail: str, fix: str) -> Finding:
    """It works, not recommended; `fix` is recommended."""
    return Finding(group, name, Severity.ADVICE, detail, fix)


def missing(group: str, name: str, detail: str, fix: str) -> Finding:
    """An iteration cannot run before `fix` is done."""
    return Finding(group, name, Severity.MISSING, detail, fix)


def skipped(group: str, name: str, why: str) -> Finding:
    """Not looked at; `why` says the reason."""
    return Finding(group, name, Severity.SKIPPED, why)
