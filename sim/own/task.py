"""`adaptsim.task`: the decorator that makes a `Task` of a function."""

from __future__ import annotations

import functools
import hashlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import make_dataclass
from pathlib import Path
from types import FunctionType
from typing import Any, ParamSpec, TypeVar

import numpy as np

from hw.plugins import did_you_mean
from hw.types import Array, frozen_array
from perception.types import Outcome
from sim.errors import TaskError
from sim.own.declaring import (
    margin_of,
    moments_of,
    number_of,
    numbers_of,
    require_apart,
    require_known,
    require_name,
    space_of,
)
from sim.own.policy import trained_for, training_of
from sim.own.reward import EndOfTrial, OutcomeInWords, conditions_of, measured, reward_of
from sim.own.scene import files_of_scenes, physics_of
from sim.own.simulation import Simulation, innermost, roles_of
from sim.own.values import Declared
from sim.tasks.files import note_declaration, of_file
from sim.tasks.task import AdaptationSettings, LabReport, Observation, Task, TaskFile
from sim.types import Space

_EXAMPLE = 2001
"""Number of moments of the trajectory with which the names of a measure are found; it exceeds the indices that a
measure uses."""

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def _named_alone(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """The same function; a wrong set of arguments raises TaskError naming the right ones."""
    signature = inspect.signature(function)

    @functools.wraps(function)
    def declared(*values: _Parameters.args, **named: _Parameters.kwargs) -> _Result:
        right = [*signature.parameters]
        if values and callable(values[0]):
            raise TaskError("@adaptsim.task has no arguments: a task needs its parameters, state, duration and reward")
        if values:
            raise TaskError(f"adaptsim.task({values[0]!r:.60}): each argument needs its name, as parameters={{...}}")
        for name, value in named.items():
            if name not in right:
                near = did_you_mean(name, right) or f": it has {', '.join(right)}"
                raise TaskError(f"{name} = {value!r:.60}: there is no such argument of adaptsim.task{near}")
        needed = [name for name, one in signature.parameters.items() if one.default is inspect.Parameter.empty]
        if missing := [name for name in needed if name not in named]:
            raise TaskError(f"adaptsim.task has no {' and no '.join(missing)}: a task needs {', '.join(needed)}")
        return function(*values, **named)

    return declared


FIRST_WORLD = "wd"
"""The world of a task that declares none: two thirds of each range."""


@_named_alone
def task(
    *,
    parameters: Mapping[str, Any],
    state: Mapping[str, Any],
    duration: float,
    reward: Callable[..., Any],
    action: Mapping[str, Any] | None = None,
    context: Mapping[str, Any] | None = None,
    nuisance: Mapping[str, Any] | None = None,
    margin: Mapping[str, Any] | None = None,
    effects: Mapping[str, Any] | None = None,
    worlds: Mapping[str, Mapping[str, Any]] | None = None,
    moments: int | Sequence[float] | None = None,
    measure: Callable[..., Mapping[str, float]] | None = None,
    outcomes: Mapping[str, Any] | None = None,
    noise: Mapping[str, float] | None = None,
    action_error: Mapping[str, float] | None = None,
    relocate: Callable[[Array, Array], Array] | None = None,
    batched: bool = False,
    trials: int = 2,
    iterations: int = 8,
    trial_std: float = AdaptationSettings.trial_std,
    train: Callable[..., Any] | None = None,
    load: Callable[..., Any] | None = None,
    policies: int | None = None,
    train_in_session: bool = False,
    time_limit_s: float | None = None,
    title: str = "",
    object_name: str = "",
) -> Callable[[Callable[..., Any]], Task]:
    """Make a task of a function `(p, action)`, `(p, context, action)` or `(p, policy)` that returns `times, states`.

    `parameters`, `context`, `action`, `nuisance` and `state` map names to `(low, high)`, `(low, high, "unit")`,
    `(low, high, "unit", "log")`, or to a list of words for a category; the bounds of `state` normalise observations.
    `duration` is in s, `moments` are the observed times or their number. `reward(end, context)` lies in [0, 1] (below 0
    counts as 0); `end` is the last state, or the numbers that `measure(times, states)` makes of the trajectory.
    `effects` are unmodelled: name -> default, or (default, low, high); only `worlds` (name -> values) change them.
    `noise` is that of the observed state, `action_error` the half-width of the error of an executed action.
    `outcomes` maps words to conditions on the end. The README of "Your own simulator" shows each
    (docs/guide/own-simulator.md).

    Raises TaskError naming the argument, its value and the right one.
    """
    arguments = dict(locals())

    def declare(function: Callable[..., Any]) -> Task:
        return _declared(function, **arguments)

    return declare


def _declared(function: Callable[..., Any], **arguments: Any) -> Task:
    written = innermost(function)
    name, file = written.__name__, _file_of(written)
    path, roles = ("" if file is None else file.path), roles_of(function)
    note_declaration(path, name)
    parameters, context, action, nuisance, state = (
        space_of(what, arguments[what]) for what in ("parameters", "context", "action", "nuisance", "state")
    )
    _require_whole(name, roles, parameters, context, action, state, arguments["train"])
    duration = number_of("duration", arguments["duration"], 1e-6)
    effects = _effects(name, file, arguments["effects"])
    effect_names = tuple(effects.__dataclass_fields__)
    require_apart({"parameters": parameters.names, "nuisance": nuisance.names, "effects": effect_names})
    simulation = Simulation(
        function, roles, path, parameters, context, action, nuisance, effects, state, duration, arguments["batched"]
    )
    times_s = moments_of(duration, arguments["moments"])
    end = _end(state, arguments["measure"], path, duration)
    ends = state if arguments["measure"] is None else None
    reward = reward_of(arguments["reward"], path, end.names, ends, context)
    moves = "context" in roles
    conditions = conditions_of(arguments["outcomes"], path, end.names, ends)

    def sent(field: str, thing: Callable[..., Any]) -> Any:
        return Declared(thing, file, name, field)

    return Task(
        name=name,
        title=arguments["title"] or _first_line(function) or name.replace("_", " "),
        object_name=arguments["object_name"] or name.replace("_", " "),
        parameters=parameters,
        margin=margin_of(parameters, arguments["margin"]),
        context=context,
        action=trained_for(parameters) if "policy" in roles else action,
        nuisance=nuisance,
        action_noise=frozen_array(
            np.zeros(len(parameters))
            if "policy" in roles
            else numbers_of("action_error", arguments["action_error"], action.names)
        ),
        observation=Observation(
            times_s=frozen_array(times_s),
            columns=tuple(range(len(state))),
            low=frozen_array(state.low),
            high=frozen_array(state.high),
            noise_mean=frozen_array(np.zeros(len(state))),
            noise_std=frozen_array(_noise(arguments["noise"], state)),
            curves=tuple(d.label for d in state.dimensions),
        ),
        adaptation=AdaptationSettings(
            horizon=int(number_of("iterations", arguments["iterations"], 1, 1000, whole=True)),
            delta=0.15,
            discount=0.9,
            threshold=0.8,
            trials_per_iteration=int(number_of("trials", arguments["trials"], 1, 1000, whole=True)),
            learning_rate=1e-3,
            trial_std=number_of("trial_std", arguments["trial_std"], 0.0, 1.0),
        ),
        unmodelled=effects,
        simulate=sent("simulate", simulation),
        simulate_many=sent("simulate_many", simulation.many) if arguments["batched"] else None,
        reference_context=frozen_array(context.middle),
        relocate=_relocation(moves, arguments["relocate"], sent),
        succeeded=sent("succeeded", has_ended),
        end_state=sent("end_state", end),
        reward_of_success=sent("reward_of_success", reward),
        report=LabReport(
            columns=tuple(d.label for d in state.dimensions),
            outcomes=(Outcome.SETTLED,),
            successes=(Outcome.SETTLED,),
            places_first=moves and arguments["relocate"] is None,
        ),
        plausible=_plausible(arguments["effects"]),
        worlds=_worlds(arguments["worlds"], parameters, nuisance, effect_names),
        physics=physics_of(written),
        scene_files=files_of_scenes(written),
        file=file,
        outcome_in_words=None if conditions is None else sent("outcome_in_words", OutcomeInWords(conditions, end)),
        **training_of(name, roles, arguments),
    )


def _noise(declared: Any, state: Space) -> Array:
    """Standard deviation of each state. Raises TaskError for one beyond its range, which would hide everything."""
    noise = numbers_of("noise", declared, state.names)
    for d, std in zip(state.dimensions, noise, strict=True):
        if std > d.high - d.low:
            raise TaskError(
                f"noise[{d.name!r}] = {std:g}: it is wider than the whole range of this state, {d.low:g} to "
                f"{d.high:g}; both must have the same unit"
            )
    return noise


def has_ended(track: Any) -> bool:
    """Whether a rollout came to its end, so that its reward counts."""
    return bool(track.outcome is Outcome.SETTLED)


def _unchanged(observation: Array, context: Array) -> Array:
    return observation


def _relocation(moves: bool, declared: Any, sent: Callable[[str, Any], Any]) -> Any:
    """None if a context is an input of the simulation; the identity if only the reward knows it."""
    if declared is not None and not callable(declared):
        raise TaskError(
            f"relocate = {declared!r}: it must be a function of an observation and a context, or left out: then the "
            "context is an input of the simulation"
        )
    if declared is not None and not moves:
        raise TaskError("relocate: the function takes no context, so an observation never moves; leave relocate out")
    if declared is not None:
        return sent("relocate", declared)
    return None if moves else sent("relocate", _unchanged)


def _require_whole(
    name: str, roles: tuple[str, ...], parameters: Space, context: Space, action: Space, state: Space, train: Any
) -> None:
    if not len(parameters):
        raise TaskError("parameters = {}: name at least one unknown quantity, as {'mu': (0.1, 0.3)}")
    if not len(state):
        raise TaskError("state = {}: name at least one observed quantity, as {'x': (0.0, 2.5, 'm')}")
    if "context" in roles and not len(context):
        raise TaskError(
            f"{name} takes a context, and the argument `context` declares none: as context={{'goal': (0, 1)}}"
        )
    if "policy" in roles:
        if train is None:
            raise TaskError(
                f"{name} takes a policy, and the argument `train` is missing: train(samples, seed) makes one"
            )
        if len(action):
            raise TaskError(f"action = {action.names}: {name} takes a policy, which chooses all; leave `action` out")
        return
    if train is not None:
        raise TaskError(f"train: {name} takes no policy; write it as {name}(p, policy)")
    if not len(action):
        raise TaskError("action = None: name what a trial can choose, as {'push': (0.3, 1.0)}")


def _end(state: Space, measure: Any, path: str, duration: float) -> EndOfTrial:
    if measure is None:
        return EndOfTrial(state, None, path, state.names)
    if not callable(measure):
        raise TaskError(f"measure = {measure!r}: it must be a function of times and states")
    if names := [name for name in state.names if hasattr(np.ndarray, name)]:
        raise TaskError(
            f"state[{names[0]!r}]: `states.{names[0]}` means something else for an array, so measure cannot read it; "
            "choose another name"
        )
    times_s = np.linspace(0.0, duration, _EXAMPLE)
    example = np.tile(state.middle, (_EXAMPLE, 1))
    return EndOfTrial(state, measure, path, tuple(measured(measure, path, times_s, example, state.names)))


def _effects(task_name: str, file: TaskFile | None, declared: Any) -> type[Any]:
    table = {} if declared is None else declared
    if not isinstance(table, Mapping):
        raise TaskError(f"effects = {declared!r}: it must map names to defaults, as {{'tilt': 0.0}}")
    columns = []
    for name, value in table.items():
        require_name(f"effects[{name!r}]", name)
        ends = value if isinstance(value, Sequence) and not isinstance(value, str) else (value,)
        if len(ends) not in (1, 3):
            raise TaskError(f"effects[{name!r}] = {value!r}: it must be a default, or (default, low, high)")
        default, *limits = (number_of(f"effects[{name!r}]", one, -np.inf) for one in ends)
        if limits and not limits[0] <= default <= limits[1]:
            raise TaskError(
                f"effects[{name!r}] = {value!r}: it must be (default, low, high), with low <= default <= high"
            )
        columns.append((name, float, default))

    def reduce(self: Any) -> Any:
        values = {name: getattr(self, name) for name, _, _ in columns}
        return (_effects_again, (file, task_name, values)) if file else (_effects_anew, (declared, values))

    return make_dataclass("Effects", columns, frozen=True, namespace={"__reduce__": reduce})


def _effects_again(file: TaskFile, task_name: str, values: Mapping[str, float]) -> Any:
    return of_file(file, task_name).unmodelled(**values)


def _effects_anew(declared: Any, values: Mapping[str, float]) -> Any:
    return _effects("", None, declared)(**values)


def _plausible(declared: Any) -> dict[str, tuple[float, float]]:
    """The effects that worlds may be drawn from: those with limits."""
    ranges = {name: value for name, value in (declared or {}).items() if isinstance(value, Sequence)}
    return {name: (float(value[1]), float(value[2])) for name, value in ranges.items() if len(value) == 3}


def _worlds(
    declared: Any, parameters: Space, nuisance: Space, effects: tuple[str, ...]
) -> dict[str, Mapping[str, Any]]:
    """Tables as in the file of a world. Values are checked once a world is loaded."""
    if declared is None:
        values = parameters.denormalise(np.full(len(parameters), 2.0 / 3.0))
        params = {
            d.name: d.words[int(v)] if d.words else _plain(d, v)
            for d, v in zip(parameters.dimensions, values, strict=True)
        }
        return {FIRST_WORLD: {"description": "Two thirds of each range.", "params": params}}
    if not isinstance(declared, Mapping):
        raise TaskError(f"worlds = {declared!r}: it must map names to values, as {{'wd': dict(mu=0.1)}}")
    tables: dict[str, Mapping[str, Any]] = {}
    for world, values in declared.items():
        where = f"worlds[{world!r}]"
        if not isinstance(world, str) or not world.replace("-", "_").isidentifier():
            raise TaskError(f"{where}: the name must be a word of letters, digits, - and _")
        if not isinstance(values, Mapping):
            raise TaskError(f"{where} = {values!r}: it must map names to values, as dict(mu=0.1)")
        require_known(where, values, (*parameters.names, *nuisance.names, *effects))
        if missing := [name for name in parameters.names if name not in values]:
            raise TaskError(f"{where} has no {', '.join(missing)}: a world states every parameter")
        groups = (("params", parameters.names), ("nuisance", nuisance.names), ("unmodelled", effects))
        tables[world] = {table: {n: _whole(values[n]) for n in names if n in values} for table, names in groups}
        _require_possible(where, tables[world]["params"], parameters)
    return tables


def _require_possible(where: str, params: Mapping[str, Any], parameters: Space) -> None:
    for d in parameters.dimensions:
        value = params[d.name]
        if d.words and value not in d.words:
            raise TaskError(f"{where}[{d.name!r}] = {value!r}: it must be one of {', '.join(d.words)}")
        if not d.words:
            number_of(f"{where}[{d.name!r}]", value, -np.inf)


def _whole(value: Any) -> Any:
    """A number of numpy as one of Python."""
    return value.item() if isinstance(value, np.generic) else value


def _plain(dimension: Any, value: float) -> Any:
    return int(value) if dimension.scale == "integer" else float(value)


def _first_line(function: Callable[..., Any]) -> str:
    line = (inspect.getdoc(function) or "").partition("\n")[0].rstrip(".")
    return line[:1].lower() + line[1:] if line[1:2].islower() else line


def _file_of(function: FunctionType) -> TaskFile | None:
    path = Path(function.__code__.co_filename)
    if not path.is_file():  # typed into a notebook
        return None
    return TaskFile(str(path.absolute()), hashlib.sha256(path.read_bytes()).hexdigest())
