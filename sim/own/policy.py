"""Tasks whose action is a policy that is trained."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sim.errors import TaskError


def training_of(name: str, roles: tuple[str, ...], arguments: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a task with trained policies; none for one with actions. Raises TaskError."""
    if "policy" in roles:
        raise TaskError(f"{name} takes a policy: trained policies are not supported yet; write {name}(p, action)")
    for name_of in ("load", "policies", "time_limit_s"):
        if arguments[name_of] is not None:
            raise TaskError(f"{name_of} = {arguments[name_of]!r}: it belongs to `train`, which is missing")
    if arguments["train_in_session"]:
        raise TaskError("train_in_session = True: it belongs to `train`, which is missing")
    return {}
