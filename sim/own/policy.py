"""Tasks whose action is a policy that is trained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sim.errors import TaskError
from sim.own.declaring import number_of
from sim.tasks.training import TrainedPolicies
from sim.types import Space


def trained_for(parameters: Space) -> Space:
    """The actions of a task with trained policies: the parameters that a policy was trained for."""
    meaning = "what the policy was trained for"
    return Space(tuple(replace(d, plain=f"policy for {d.name}", meaning=meaning) for d in parameters.dimensions))


def training_of(name: str, roles: tuple[str, ...], arguments: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a task with trained policies; none for one with actions. Raises TaskError."""
    if "policy" in roles:
        values = {key: arguments[key] for key in ("policies", "time_limit_s") if arguments[key] is not None}
        for what in ("train", "load"):
            if arguments[what] is not None and not callable(arguments[what]):
                raise TaskError(f"{what} = {arguments[what]!r}: it must be a function")
        if "policies" in values:
            values["policies"] = int(number_of("policies", arguments["policies"], 2, 10_000, whole=True))
        if "time_limit_s" in values:
            values["time_limit_s"] = number_of("time_limit_s", arguments["time_limit_s"], 1e-3)
        session = bool(arguments["train_in_session"])
        return {"training": TrainedPolicies(arguments["train"], arguments["load"], train_in_session=session, **values)}
    for name_of in ("load", "policies", "time_limit_s"):
        if arguments[name_of] is not None:
            raise TaskError(f"{name_of} = {arguments[name_of]!r}: it belongs to `train`, which is missing")
    if arguments["train_in_session"]:
        raise TaskError("train_in_session = True: it belongs to `train`, which is missing")
    return {}
