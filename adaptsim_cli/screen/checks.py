"""Whether something is ready: one sentence a check, which says what to do where it is not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Readiness:
    """One line of the checklist before a session."""

    name: str
    ok: bool
    detail: str  # what was found, and where not ok what to do


def failures(checks: Sequence[Readiness]) -> str:
    """The failing checks in one message."""
    return "; ".join(f"{check.name}: {check.detail}" for check in checks if not check.ok)
