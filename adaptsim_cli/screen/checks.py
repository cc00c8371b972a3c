"""Readiness checks: one sentence per check; a failing one says what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Readiness:
    """One line of the checklist before a session."""

    name: str
    ok: bool
    detail: str  # the finding, and the remedy if not ok


def failures(checks: Sequence[Readiness]) -> str:
    """The failing checks in one message."""
    return "; ".join(f"{check.name}: {check.detail}" for check in checks if not check.ok)
