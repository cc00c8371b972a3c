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


def training_of(name: str, roles: tuple[str, ...], given: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a task with trained policies; none for one with actions. Raises TaskError."""
    if "policy" in roles:
        given_values = {key: given[key] for key in ("policies", "time_limit_s") if given[key] is not None}
        for what in ("train", "load"):
            if given[what] is not None and not callable(given[what]):
                raise TaskError(f"{what} = {given[what]!r}: it must be a function")
        if "policies" in given_values:
            given_values["policies"] = int(number_of("policies", given["policies"], 2, 10_000, whole=True))
        if "time_limit_s" in given_values:
            given_values["time_limit_s"] = number_of("time_limit_s", given["time_limit_s"], 1e-3)
        session = bool(given["train_in_session"])
        return {"training": TrainedPolicies(given["train"], given["load"], train_in_session=session, **given_values)}
    for argument in ("load", "policies", "time_limit_s"):
        if given[argument] is not None:
            raise TaskError(f"{argument} = {given[argument]!r}: it belongs to `train`, which is missing")
    if given["train_in_session"]:
        raise TaskError("train_in_session = True: it belongs to `train`, which is missing")
    return {}
