"""Environments of gymnasium: parameters are attributes, by path; one rollout with a policy."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hw import extras
from hw.types import Array
from sim.errors import ExtraMissing, TaskError
from sim.own.scene import attributes, indexed, missing, require_paths, set_attribute, value_of


def gym(env_id: str, paths: Mapping[str, str], **options: Any) -> GymScene:
    """An environment of gymnasium, and where its parameters are: `{"m": "m", "g": "model.opt.gravity[2]"}`.

    Calling it with `p` makes a new environment, so that nothing is left in it for the next rollout. `options` go to
    `gymnasium.make`. Raises TaskError for a wrong path, ExtraMissing without gymnasium.
    """
    return GymScene(env_id, require_paths("gym: paths", paths), options)


@dataclass(frozen=True, eq=False)
class GymScene:
    """See `gym`."""

    env_id: str
    paths: Mapping[str, str]
    options: Mapping[str, Any] = field(default_factory=dict)
    physics: str = field(default="gymnasium", init=False)

    def __call__(self, p: Any) -> Any:
        """A new environment, without wrappers, with the values of `p`."""
        gymnasium = _gymnasium()
        try:
            env = gymnasium.make(self.env_id, **self.options).unwrapped
        except gymnasium.error.Error as error:
            raise TaskError(f"{self.env_id!r} is not an environment that can be made: {error}") from error
        for name, path in self.paths.items():
            where = f"{self.env_id}: {name} = {path!r}"
            thing, attribute = _attribute_at(env, path, where)
            set_attribute(thing, attribute, value_of(p, name, where), where)
        return env


def run_gym(
    env: str | GymScene,
    p: Any,
    paths: Mapping[str, str] | None = None,
    start: Callable[[Any], Any] | None = None,
    see: Callable[[Any], Any] | None = None,
    steps: int = 200,
    dt: float | None = None,
    seed: int = 0,
) -> tuple[Array, Array]:
    """One rollout: times (N,) and states (N, k), the values of `see(env)` at the start and after each of the `steps`.

    `start(observation)` chooses the action. An environment that ends earlier ends the rollout. `dt` is the time of a
    step in s; by default it is the environment's own (`env.dt`). `seed` is that of `env.reset`.
    """
    scene = env if isinstance(env, GymScene) else gym(env, paths or {})
    if start is None or see is None:
        raise TaskError("run_gym: `start` (observation -> action) and `see` (environment -> state) are needed")
    instance = scene(p)
    step_s = dt if dt is not None else getattr(instance, "dt", None)
    if step_s is None or not math.isfinite(step_s) or step_s <= 0.0:
        raise TaskError(f"run_gym: dt = {step_s!r}: give the time of a step in s, above 0")
    observation, _ = instance.reset(seed=seed)
    states = [_state(see, instance)]
    try:
        for _ in range(steps):
            action = np.asarray(start(observation), dtype=instance.action_space.dtype)
            if action.shape != instance.action_space.shape:
                raise TaskError(
                    f"run_gym: `start` returns an action of shape {action.shape}; {scene.env_id} takes "
                    f"{instance.action_space.shape}"
                )
            observation, _, ended, _, _ = instance.step(action if action.shape else action.item())
            states.append(_state(see, instance))
            if ended:
                break
    finally:
        instance.close()
    return float(step_s) * np.arange(len(states), dtype=np.float64), np.array(states)


def _state(see: Callable[[Any], Any], env: Any) -> Array:
    return np.array(see(env), dtype=np.float64).reshape(-1)


def _attribute_at(env: Any, path: str, where: str) -> tuple[Any, str]:
    """The thing that has the attribute at the end of a path, and that attribute."""
    *parts, last = path.split(".")
    thing = env
    for part in parts:
        name, index = indexed(part, where)
        if not hasattr(thing, name):
            raise TaskError(missing(where, f"attribute {name!r}", attributes(thing)))
        thing = getattr(thing, name)
        for i in index:
            thing = thing[i]
    return thing, last


def _gymnasium() -> Any:
    try:
        import gymnasium  # noqa: PLC0415 - an optional package
    except ModuleNotFoundError as error:
        raise ExtraMissing(extras.missing("an environment of gymnasium", "gymnasium", "gymnasium")) from error
    return gymnasium
