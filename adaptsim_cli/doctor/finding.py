"""The finding of one check."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Severity(Enum):
    """The severity of a finding; only MISSING prevents an iteration."""

    OK = "ok"
    ADVICE = "advice"  # works, not recommended
    MISSING = "missing"  # an iteration cannot run
    SKIPPED = "skipped"


@dataclass(frozen=True)
class Finding:
    """One line of the checklist. `fix` is the remedy, a command if there is one."""

    group: str
    name: str
    verdict: Severity
    detail: str
    fix: str = ""


def ok(group: str, name: str, detail: str) -> Finding:
    """Ready; no remedy needed."""
    return Finding(group, name, Severity.OK, detail)


def advice(group: str, name: str, detail: str, fix: str) -> Finding:
    """It works, not recommended; `fix` is recommended."""
    return Finding(group, name, Severity.ADVICE, detail, fix)


def missing(group: str, name: str, detail: str, fix: str) -> Finding:
    """An iteration cannot run until `fix` is done."""
    return Finding(group, name, Severity.MISSING, detail, fix)


def skipped(group: str, name: str, why: str) -> Finding:
    """Not checked, for the reason `why`."""
    return Finding(group, name, Severity.SKIPPED, why)
