"""Rows inside the outputs of the commands around tasks, worlds, checkpoints and benchmarks."""

from __future__ import annotations

from pydantic import Field

from adaptsim_cli.screen.outputs import described, optional
from hw.records import Record


class WorldRow(Record):
    """One world of the simulated lab."""

    name: str = described("its name")
    task: str = described("which task")
    description: str = described("one sentence")
    physics: str = described("the simulator that it runs in")


class Described(Record):
    """One parameter, context, action or nuisance of a task."""

    name: str = described("its name")
    plain_name: str = described("its plain name")
    unit: str = described("its unit; empty for a plain number")
    meaning: str = described("what it is, in one line")
    low: float = described("lower end of its range")
    high: float = described("upper end of its range")


class RevealedParameter(Record):
    """One parameter of a simulated world, beside the belief of a session."""

    name: str = described("its name")
    plain_name: str = described("its plain name")
    unit: str = described("its unit")
    meaning: str = described("what it is, in one line")
    scale: str = described("how it is normalised: linear, log or integer")
    truth: float = described("its true value, which no session sees")
    low: float = described("lower end of the range of training")
    high: float = described("upper end of it")
    believed: tuple[float, float, float] | None = described(
        "lower end, median and upper end of 90 % of the posterior; null where it collapsed onto one sample"
    )
    kinds: list[str] = Field(default=[], description="the words of a category, by its value; empty for a number")
    chances: list[float] | None = Field(
        default=None,
        description="the probability of each of these words; null for a number, or if the posterior collapsed",
    )


class Revealed(Record):
    """The truth of a simulated world beside a session in it."""

    session: str = described("which session")
    method: str = described("its method")
    world: str = described("which world")
    parameters: list[RevealedParameter] = described("one each")
    unmodelled: list[str] = described("effects of the world that no parameter expresses and training did not have")
    trials: int = described("its trials so far")
    rewards: list[float] = described("mean reward of each complete iteration; of the first one also while it runs")
    chosen_after: int | None = described("trials before its best policy was first tried; null: not tried or not known")
    udr_reward: float = described("mean reward there of UDR, one policy for the whole range, without arm or camera")
    udr_trials: int = described("simulated trials behind it")


class CheckpointRow(Record):
    """One checkpoint."""

    task: str = described("its task; ? if its card cannot be read")
    name: str = described("its name")
    created: str = described("when it was made")
    folder: str = described("its folder")


class Figure(Record):
    """One figure of a card."""

    name: str = described("what it is")
    card: float = described("value on the card")
    found: float = described("value by fresh rollouts")
    tolerance: float = described("by how much it may be worse")
    better: str = described("whether a larger or smaller value is better")
    holds: bool = described("whether the card is right about it")


class Identifiable(Record):
    """How well sessions can identify one parameter."""

    name: str = described("its name")
    title: str = described("its plain name, with the unit")
    left: float = described("share of the error that remains after the trials; 1: they say nothing about it")
    words: str = described("the same in words")


class HeldOut(Record):
    """The error of an emulator by fresh rollouts."""

    rollouts: int = described("how many")
    accuracy: float = described("share of outcomes foretold")
    position_error_median: float = described("of the last observed position, in state units")
    end_state_error_median: float | None = optional("of successes, in units; null without one")


class CheckedFinding(Record):
    """One rule that a task keeps or breaks."""

    check: str = described("what every task keeps")
    mark: str = described("kept, doubtful or broken")
    detail: str = described("one sentence; empty if there is nothing to say")
