"""Tasks whose action is a policy that is trained."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sim.errors import TaskError


def training_of(name: str, roles: tuple[str, ...], given: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a task with trained policies; none for one with actions. Raises TaskError."""
    if "policy" in roles:
        raise TaskError(f"{name} takes a policy: trained policies are not supported yet; write {name}(p, action)")
    for argument in ("load", "policies", "time_limit_s"):
        if given[argument] is not None:
            raise TaskError(f"{argument} = {given[argument]!r}: it belongs to `train`, which is missing")
    if given["train_in_session"]:
        raise TaskError("train_in_session = True: it belongs to `train`, which is missing")
    return {}
