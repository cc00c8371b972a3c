"""The rules for every task, checked by some rollouts: numbers, rewards, order, ranges, units, contexts.

The rollouts vary one quantity at a time around a middle, then all of them at once. They are repeated in reverse order,
so a state that is left in a shared model shows.
"""

from __future__ import annotations

import pickle
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from perception.types import ObjectTrack, Outcome
from sim.errors import RolloutError
from sim.rollouts.draws import cover
from sim.rollouts.reward_soundness import reward_complaints, reward_knows, reward_tells
from sim.rollouts.sampled_rollouts import Cost, SampledRollout, TaskFinding, described, rolled, sampled_rollouts
from sim.tasks.declared import require_declared
from sim.tasks.library import LibraryRollouts, PolicyLibrary, library_of
from sim.tasks.members import train_member
from sim.tasks.task import Task
from sim.types import Space

CONTEXTS, BASES = 3, 4
"""Number of contexts, and of rollouts at each, with which a `relocate` is compared with the simulation."""

SAME = 0.02
"""Largest difference of normalised observations that counts as the same motion."""

TOO_WIDE, TOO_NARROW = 200.0, 20.0
"""A range has another unit if it is this many times wider, or narrower, than all observed values."""

TOO_LATE = 100.0
"""A rollout has its times in another unit if it ends this many times later than the last observed moment."""

_SAMPLES = 16
"""Draws of parameters for the training of the one policy of a check."""


def require_sound(task: Task, rng: np.random.Generator, limit_s: float = 3.0) -> None:
    """Raises RolloutError or TaskError for the first rule that the task breaks."""
    for finding in examine(task, rng, limit_s):
        if finding.mark == "broken":
            raise RolloutError(finding.detail)


def examine(
    task: Task,
    rng: np.random.Generator,
    limit_s: float = 60.0,
    timed: Callable[[Cost], None] = lambda cost: None,
) -> Iterator[TaskFinding]:
    """The findings about the task, one after another; the first broken rule of a kind ends the checks of that kind.

    Rollouts take about `limit_s`, at least nine of them. Raises TaskError for wrong values, RolloutError for a rollout
    that raises.
    """
    require_declared(task)
    yield TaskFinding("the values of the task fit each other", "kept")
    if task.training is not None and library_of(task) is None:
        task, trained_s = _with_a_policy(task)
        yield TaskFinding("a policy can be trained, stored and loaded", "kept", f"its training took {trained_s:.3g} s")
    rolls, ends = sampled_rollouts(task, rng, limit_s / 2)
    seconds = [one.seconds for one in rolls]
    timed(Cost(len(rolls), float(np.median(seconds)), max(seconds)))
    yield from _first_broken(f"{len(rolls)} rollouts give numbers", _numbers(task, rolls))
    yield from _first_broken("the same rollouts repeat exactly, in reverse order too", _order(task, rolls, limit_s / 2))
    yield from _first_broken(
        "rewards are numbers from 0 to 1, and take stacks of trials", reward_complaints(task, rolls)
    )
    yield from reward_tells(task, rolls, rng)
    yield from _first_broken("the observed moments lie within the rollouts", _moments(task, rolls))
    yield from _units(task, rolls)
    yield from _contexts(task, rolls, rng, limit_s / 4)
    yield from _sensitive(task, rolls, ends, rng)
    yield from _first_broken("outcomes are those of the report", _outcomes(task, rolls))


def _with_a_policy(task: Task) -> tuple[Task, float]:
    """The task with one policy, trained for all of Omega, and the time of the training. Raises TaskError."""
    samples = cover(task.parameters, _SAMPLES, np.random.default_rng(0))
    with tempfile.TemporaryDirectory() as folder:
        member = train_member(task, "everywhere", samples, task.parameters.middle, 0, Path(folder) / "everywhere")
        library = PolicyLibrary((member,))
        library.policy(task, member)  # kept in memory, so that the files may go
    return replace(task, simulate=LibraryRollouts(task, library), simulate_many=None), member.seconds


def _first_broken(check: str, complaints: Iterator[str]) -> Iterator[TaskFinding]:
    complaint = next(complaints, None)
    yield TaskFinding(check, "kept") if complaint is None else TaskFinding(check, "broken", complaint)


def _numbers(task: Task, rolls: Sequence[SampledRollout]) -> Iterator[str]:
    width = max(task.observation.columns) + 1
    if task.report is not None:
        width = len(task.report.columns)
    for one in rolls:
        track = one.track
        if not isinstance(track.outcome, Outcome):
            yield f"`simulate` of the task {task.name} gives the outcome {track.outcome!r}: it must be one of Outcome"
            continue
        if not len(track.t_s) or (np.diff(track.t_s) <= 0.0).any():
            times = np.round(track.t_s[:4], 4).tolist()
            yield f"the times of a rollout of {task.name} do not increase: they begin {times}; t_s must increase, in s"
        if track.state.shape[1] < width or (task.report is not None and track.state.shape[1] != width):
            what = "report.columns names" if task.report is not None else "observation.columns needs"
            yield f"the states of {task.name} have {track.state.shape[1]} columns, and {what} {width}: both must agree"
            continue
        if track.outcome is Outcome.SOLVER_FAILED:
            why = f" ({track.flags[0]})" if track.flags else ""
            yield f"a rollout of {task.name} fails{why} with {described(task, one)}: the whole margin must be simulated"
        if not np.isfinite(task.observation(track)).all():
            inputs = described(task, one)
            yield f"the task {task.name} has observations that are not finite with {inputs}: check its states"


def _order(task: Task, rolls: Sequence[SampledRollout], limit_s: float) -> Iterator[str]:
    spent, repeated = 0.0, [*reversed(rolls)]
    for one in repeated:
        if spent > limit_s:
            break
        again = rolled(task, *one.inputs)
        spent += again.seconds
        if _same(one.track, again.track):
            continue
        both = one.track.state, again.track.state
        off = np.abs(both[0] - both[1]).max() if both[0].shape == both[1].shape else float("nan")
        before = pickle.dumps(np.random.get_state())  # noqa: NPY002 - whether the task draws from it
        third = rolled(task, *one.inputs)
        draws = pickle.dumps(np.random.get_state()) != before  # noqa: NPY002
        left = "something is left in a shared model: make a new one, or reset it, in each call"
        chance = (
            "`simulate` may use no random numbers but its arguments: seed them there, or take them from the nuisance"
        )
        differs = f"the same rollout differs by up to {off:.3g}"
        if _same(again.track, third.track):
            yield (
                f"a rollout of {task.name} depends on the rollouts before it: repeated in reverse order, {differs}; "
                f"{left}"
            )
        elif draws:
            yield f"the task {task.name} is not deterministic: {differs} the second time. {chance}"
        else:
            yield (
                f"the task {task.name} is not deterministic: {differs} when rollouts are repeated in reverse. "
                f"Either {left}; or it draws: {chance}"
            )
    if task.simulate_many is not None:
        stack = [np.stack(values) for values in zip(*(one.inputs for one in rolls), strict=True)]
        tracks = task.simulate_many(*stack)
        if len(tracks) != len(rolls):
            yield f"`simulate_many` of {task.name} returns {len(tracks)} tracks for {len(rolls)} rollouts"
            return
        for one, other in zip(rolls, tracks, strict=True):
            off = np.abs(task.observation(one.track) - task.observation(other)).max()
            if one.track.outcome is not other.outcome or not off <= 1e-6:
                yield (
                    f"`simulate_many` of {task.name} differs from `simulate` by {off:.3g} of the range with "
                    f"{described(task, one)}: both must be the same physics"
                )


def _same(one: ObjectTrack, other: ObjectTrack) -> bool:
    return (
        one.outcome is other.outcome
        and np.array_equal(one.t_s, other.t_s)
        and np.array_equal(one.state, other.state, equal_nan=True)
    )


def _moments(task: Task, rolls: Sequence[SampledRollout]) -> Iterator[str]:
    last_s, longest_s = float(task.observation.times_s[-1]), max(float(one.track.t_s[-1]) for one in rolls)
    if longest_s < 0.75 * last_s:
        yield (
            f"the last observed moment of {task.name} is {last_s:g} s, and the longest rollout ends at {longest_s:.3g} "
            "s: the observed times must lie within the rollouts"
        )
    if longest_s > TOO_LATE * last_s:
        yield (
            f"the last observed moment of {task.name} is {last_s:g} s, and a rollout ends at {longest_s:.4g} s: times "
            "are in s"
        )
    first_s, latest_s = float(task.observation.times_s[0]), max(float(one.track.t_s[0]) for one in rolls)
    if latest_s > first_s + 0.1 * last_s:
        yield (
            f"the first observed moment of {task.name} is {first_s:g} s, and a rollout begins at {latest_s:.4g} s: its "
            "times must begin at 0, or its moments there"
        )


def _units(task: Task, rolls: Sequence[SampledRollout]) -> Iterator[TaskFinding]:
    check, o = "the states lie in their ranges", task.observation
    states = np.concatenate([one.track.at(o.times_s)[:, list(o.columns)] for one in rolls])
    names = task.report.columns if task.report else tuple(f"column {c}" for c in range(states.shape[1]))
    outside = []
    for i, column in enumerate(o.columns):
        values, low, high = states[:, i], float(o.low[i]), float(o.high[i])
        name, most, reach = (
            names[column] if column < len(names) else f"column {column}",
            np.abs(values).max(),
            high - low,
        )
        extent = f"{name} runs from {values.min():.4g} to {values.max():.4g}, and its range is {low:g} to {high:g}"
        if 0.0 < most < max(abs(low), abs(high)) / TOO_WIDE:
            yield TaskFinding(
                check, "broken", f"the state {extent}, hundreds of times as wide: both must have the same unit"
            )
            return
        if max(low - values.min(), values.max() - high) > TOO_NARROW * reach:
            yield TaskFinding(check, "broken", f"the state {extent}, far too narrow: both must have the same unit")
            return
        if max(low - values.min(), values.max() - high) > 0.5 * reach:
            outside.append(extent)
        elif np.ptp(values) == 0.0:
            outside.append(f"{name} is always {values[0]:g}")
    yield TaskFinding(check, "doubtful" if outside else "kept", "; ".join(outside))


def _sensitive(
    task: Task, rolls: Sequence[SampledRollout], ends: int, rng: np.random.Generator
) -> Iterator[TaskFinding]:
    base, silent = rolls[0], {"parameters": list[str](), "action": list[str]()}
    tried = {"parameters": set[str](), "action": set[str]()}
    for one in rolls[1:ends]:
        what = "parameters" if not np.array_equal(one.parameters, base.parameters) else "action"
        space = task.parameters if what == "parameters" else task.action
        index = int(np.argmax(getattr(one, what) != getattr(base, what)))
        name = space.names[index]
        tried[what].add(name)
        if not np.array_equal(task.observation(one.track), task.observation(base.track)):
            silent[what] = [n for n in silent[what] if n != name]
            tried[what].discard(name)
            tried[what].add(f"{name} ")
        elif f"{name} " not in tried[what] and name not in silent[what]:
            silent[what].append(name)
    spaces = [("parameters", task.parameters), ("action", task.action)]
    for what, space in spaces if task.training is None else spaces[:1]:  # one policy is one action
        check = f"each of the {what} changes the motion" if what == "parameters" else "each action changes the motion"
        if len(silent[what]) == len(space) and _ignored(task, rolls, what, rng):
            yield TaskFinding(
                check, "broken", f"`simulate` of {task.name} ignores its {what}: nothing changes the motion"
            )
        elif silent[what]:
            names = ", ".join(silent[what])
            yield TaskFinding(
                check, "doubtful", f"{names} changes nothing around the middle of the ranges: is it used?"
            )
        else:
            yield TaskFinding(check, "kept")


def _ignored(task: Task, rolls: Sequence[SampledRollout], what: str, rng: np.random.Generator) -> bool:
    """Whether all of the parameters, or all actions, change nothing in a few rollouts."""
    space: Space = task.margin if what == "parameters" else task.action
    for one in rolls[-BASES:]:
        values = {"parameters": one.parameters, "action": one.action, what: space.sample(rng, 1)[0]}
        other = rolled(task, values["parameters"], one.context, values["action"], one.nuisance)
        if not np.array_equal(task.observation(other.track), task.observation(one.track)):
            return False
    return True


def _contexts(
    task: Task, rolls: Sequence[SampledRollout], rng: np.random.Generator, limit_s: float
) -> Iterator[TaskFinding]:
    if not len(task.context):
        return
    reference = np.asarray(task.reference_context, dtype=np.float64)
    worst, off_by, pairs, apart = None, 0.0, 0, 0
    moved = 0.0
    began = time.perf_counter()
    for base in rolls[-BASES:]:
        if time.perf_counter() - began > limit_s:
            break
        at_reference = rolled(task, base.parameters, reference, base.action, base.nuisance)
        here = task.observation(at_reference.track)
        for context in task.context.sample(rng, CONTEXTS):
            true = task.observation(rolled(task, base.parameters, context, base.action, base.nuisance).track)
            moved = max(moved, float(np.abs(true - here).max()))
            if task.relocate is None:
                continue
            difference = np.abs(true - np.asarray(task.relocate(here, context)))
            pairs, apart = pairs + 1, apart + bool(difference.max() > SAME)
            if difference.max() > off_by:
                off_by, worst = float(difference.max()), (context, int(difference.argmax()), true, here)
    ends = [np.atleast_1d(end) for one in rolls if (end := task.end_of(one.track)) is not None]
    if moved == 0.0 and ends and not reward_knows(task, np.stack(ends), rng):
        detail = f"{', '.join(task.context.names)} changes neither the motion nor the reward: is it used?"
        yield TaskFinding("contexts matter", "doubtful", detail)
    if task.relocate is None:
        silent = "" if moved > 0.0 else "no context changes the motion: leave it out of the function's arguments"
        yield TaskFinding("contexts change the motion", "doubtful" if silent else "kept", silent)
        return
    check = "`relocate` is right: a context moves an observation as it says"
    if worst is None or apart <= pairs / 2:
        yield TaskFinding(check, "kept")
        return
    context, place, true, here = worst
    believed = np.asarray(task.relocate(here, context))
    where = ", ".join(f"{n} = {v:.4g}" for n, v in zip(task.context.names, context, strict=True))
    yield TaskFinding(
        check,
        "broken",
        f"`relocate` of {task.name} is wrong: at {where} the simulation observes {true[place]:.3f} (normalised), and "
        f"relocate says {believed[place]:.3f}. For a context that changes the motion, leave relocate out (None), or "
        "correct it",
    )


def _outcomes(task: Task, rolls: Sequence[SampledRollout]) -> Iterator[str]:
    report, track = task.report, rolls[0].track
    failed = replace(track, outcome=Outcome.SOLVER_FAILED)
    if report is None:
        if task.succeeded(failed):
            yield f"`succeeded` of {task.name} counts the outcome solver_failed as a success: it must not"
        return
    for one in rolls:
        if one.track.outcome not in {*report.outcomes, Outcome.SOLVER_FAILED}:
            yield (
                f"a rollout of {task.name} ends {one.track.outcome.value}, and report.outcomes has "
                f"{', '.join(report.outcomes)}: it must name every end"
            )
    for outcome in Outcome:
        counts, named = task.succeeded(replace(track, outcome=outcome)), outcome in report.successes
        if counts != named:
            yield (
                f"`succeeded` of {task.name} says {counts} for the outcome {outcome.value}, and report.successes has "
                f"{', '.join(report.successes)}: both must agree"
            )
