"""Outputs of the commands that make trials: run-iteration, rollout, preview."""

from __future__ import annotations

from adaptsim_cli.outputs.base import Output, Part, Quantities, said
from sim.adaptation.verdict import Verdict

UNITS = "unit of every parameter, context and action by its name; empty for a plain number"


class Trial(Part):
    """One completed trial that counts."""

    trial: int = said("number of the trial in the session, from 1")
    context: Quantities = said("context as measured, in `units`")
    action: Quantities = said("commanded action, in `units`")
    reward: float = said("between 0 and 1")
    outcome: str = said("how it ended, a value of `perception.types.Outcome`")
    observation: list[float] = said("motion of the object, normalised with the task's fixed bounds, time by time")


class Particle(Part):
    """One particle with its trials."""

    params: Quantities = said("parameters that its trials were made with, in `units`")
    trials: list[Trial] = said("its trials of this iteration")
    mean_reward: float = said("of these trials")
    next_params: Quantities = said("parameters of the next iteration, in `units`")


class Best(Part):
    """The best parameters of the session so far."""

    params: Quantities = said("parameters, in `units`")
    mean_reward: float = said("estimated reward of their policy")
    trials: int = said("trials behind the estimate")
    ci95: tuple[float, float] = said("95 % interval of the estimate")


class Outlook(Part):
    """The expected gain of another iteration."""

    gain: float = said("reward that one more iteration is expected to bring")
    likely: float = said("chance that more than 0.05 is left to gain")
    done: bool = said("another iteration is not worth its trials")
    hopeless: bool = said("nothing in the ranges of the action is expected to work")
    correction: list[float] = said(
        "the correction that the trials add to the simulator's action, in the order of the action"
    )
    correction_std: list[float] = said("its standard deviation over contexts")


class Iteration(Output):
    """The result of one iteration: one object per line and iteration."""

    task: str = said("which task")
    session: str = said("which session")
    iteration: int = said("number of the iteration, from 1")
    hw: str = said("hardware: fake, panda or fr3")
    world: str = said("world of the simulated lab; empty on a real arm")
    seed: int = said("seed of all random numbers")
    units: dict[str, str] = said(UNITS)
    particles: list[Particle] = said("particles, side by side")
    best: Best = said("the best parameters so far")
    verdict: Verdict = said("whether to stop or to go on, and why")
    outlook: Outlook | None = said("null if the method does not look ahead")
    timing_s: dict[str, float] = said("wall time by stage; `other` has no name, `total` is their sum")


class Track(Part):
    """The tracked object."""

    t_s: list[float] = said("times, from the start of the tool's motion")
    state: list[list[float]] = said("a row for each time: position in m, or the states of a task without an arm")
    confidence: list[float] = said("between 0 and 1, for each time")
    outcome: str = said("how it ended")
    end_in_tool_m: list[float] | None = said("the object's last position in the tool's frame; null if unknown")
    flags: list[str] = said("warnings of the tracking and of the end of the motion")


class Rollout(Output):
    """One single trial."""

    task: str = said("which task")
    hw: str = said("hardware: fake, panda or fr3")
    world: str = said("world of the simulated lab; empty on a real arm")
    seed: int = said("seed of all random numbers")
    units: dict[str, str] = said(UNITS)
    params: Quantities | None = said("parameters of the policy; null if the action was chosen by hand")
    context: Quantities = said("context as measured, in `units`")
    goal_m: list[float] | None = said("(x, y) of the goal, for a task with a goal on the table")
    action: Quantities = said("commanded action, in `units`")
    camera_late_s: float = said("calibrated delay of the camera's time stamps, already subtracted")
    outcome: str = said("how it ended")
    reward: float = said("between 0 and 1")
    flags: list[str] = said("warnings of the tracking and of the end of the motion")
    observation: list[float] = said("motion of the object, normalised with the task's fixed bounds, time by time")
    track: Track = said("the tracked object")
    when: str = said("when it was made")


class Limit(Part):
    """One limit of one path."""

    path: str = said("approach, motion or return")
    quantity: str = said("the limited quantity")
    where: str = said("joint or part")
    t_s: float = said("time at which it comes closest to its limit, from the start of the path")
    value: float = said("the value then, in `unit`")
    limit: float = said("the limit, in `unit`")
    unit: str = said("unit of both")
    ratio: float = said("share of the limit that is used, 1 is all of it")


class Preview(Output):
    """One planned motion."""

    task: str = said("which task")
    arm: str = said("for which arm")
    units: dict[str, str] = said(UNITS)
    context: Quantities = said("context that it was planned for, in `units`")
    action: Quantities = said("its action, in `units`")
    duration_s: list[float] = said("of approach, motion and return")
    limits: list[Limit] = said("every limit of every path")
