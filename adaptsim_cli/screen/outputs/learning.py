"""Outputs of the commands around worlds, checkpoints and benchmarks."""

from __future__ import annotations

from typing import Any

from adaptsim_cli.screen.outputs import Output, Quantities, described, optional
from adaptsim_cli.screen.outputs.trials import UNITS
from hw.records import Record
from sim.adaptation.trials_forecast import TrialsForecast


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


class Worlds(Output):
    """The worlds of a task, and the meaning of its quantities."""

    worlds: list[WorldRow] = described("one each")
    quantities: list[Described] = described("parameters, contexts, actions and nuisance of the task")


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


class WorldOutput(Output):
    """The hidden values of a world. A session never sees them."""

    task: str = described("which task")
    world: str = described("which world")
    description: str = described("one sentence")
    physics: str = described("the simulator that it runs in")
    units: dict[str, str] = described(UNITS)
    parameters: Quantities = described("true parameters, in `units`")
    nuisance: Quantities = described("values that differ from trial to trial, in `units`")
    unmodelled: dict[str, Any] = described("effects that no parameter expresses")
    seed: int | None = optional("seed of errors and noise; null for a world without an arm")
    sensing: dict[str, Any] | None = optional("errors of camera and joints")
    mount: dict[str, Any] | None = optional("errors of table and tool")
    faults: dict[str, Any] | None = optional("faults, by trial")
    X_BC: list[list[float]] | None = optional("true pose of the camera in the arm's base, 4 x 4, m")
    joint_zeros_rad: list[float] | None = optional("true zeros of the joints")
    X_FT: list[list[float]] | None = optional("true pose of the tool in the flange, 4 x 4, m")
    revealed: Revealed | None = optional("truth, range and belief of the newest session in this world")
    trials: list[dict[str, Any]] | None = optional("place and motion of the object in every trial so far")


class CheckpointRow(Record):
    """One checkpoint."""

    task: str = described("its task; ? if its card cannot be read")
    name: str = described("its name")
    created: str = described("when it was made")
    folder: str = described("its folder")


class Checkpoints(Output):
    """The shipped checkpoints and the user's own."""

    checkpoints: list[CheckpointRow] = described("one each")


class Figure(Record):
    """One figure of a card."""

    name: str = described("what it is")
    card: float = described("value on the card")
    found: float = described("value by fresh rollouts")
    tolerance: float = described("by how much it may be worse")
    better: str = described("whether a larger or smaller value is better")
    holds: bool = described("whether the card is right about it")


class CheckpointVerified(Output):
    """A checkpoint against its card."""

    task: str = described("which task")
    folder: str = described("its folder")
    sha256: str = described("hash of its weights")
    holds: bool = described("whether the card is right about every figure")
    figures: list[Figure] = described("one each")


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


class OwnObjectOutput(Output):
    """An own object: its file, its picture, its checkpoint."""

    object: str = described("its name")
    file: str = described("the TOML file")
    picture: str | None = optional("PNG of the object in the lab; null for a task without an arm")
    inside: bool = described("whether the shipped emulator serves it as it is")
    checkpoint: str = described("folder of its checkpoint")
    held_out: HeldOut | None = optional("the error of its emulator; null for a task that is solved exactly")
    parameters: list[Identifiable] = described("which of them a session can estimate")


class CheckpointParameters(Output):
    """Which parameters sessions can identify."""

    folder: str = described("of the checkpoint")
    task: str = described("which task")
    sessions: int = described("simulated targets")
    trials: int = described("trials in each")
    parameters: list[Identifiable] = described("one each")


class TrialsOutput(Output):
    """How many trials a session will need."""

    folder: str = described("of the checkpoint")
    is_kept: bool = described("whether it was kept there, and sessions show it")
    forecast: TrialsForecast = described("by sessions in imagined worlds")


class Pretrained(Output):
    """A checkpoint that was trained."""

    checkpoint: str = described("its folder")
    card: dict[str, Any] = described("its card, with the held-out results")


class BenchmarkOutput(Output):
    """Methods compared; [files](files.md#benchmarkjson) describes the rows field by field."""

    format: int = described("version of the results' files")
    task: str = described("which task")
    conditions: dict[str, Any] = described("trials of each session, and how policies were judged")
    trials: str = described(
        "their source: simulated (true rollouts), tables (looked up), lab (arm and camera), recorded"
    )
    recorded: str | None = optional("hash of the recorded trials; absent: none were")
    held_out: float | None = optional("fraction of the recorded trials held out for scoring")
    checkpoints: Any = described("checkpoints of the methods")
    targets: list[str] = described("worlds")
    seeds: int = described("sessions per world and method")
    left_out: dict[str, str] = described("methods that these checkpoints do not hold, and why")
    rows: list[dict[str, Any]] = described("one for a method, a world and a seed")
    summary: list[dict[str, Any]] = described("one for a set of worlds")
    strata: dict[str, Any] | None = optional(
        "worlds in need of an action of their own and the others; absent: not sealed"
    )
    report: str = described("page that was written")


class WorldTables(Output):
    """Tables of true rollouts that were made."""

    task: str = described("which task")
    tables: list[dict[str, Any]] = described("one a world")
