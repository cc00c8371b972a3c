"""Outputs of the commands around worlds, checkpoints and benchmarks."""

from __future__ import annotations

from typing import Any

from adaptsim_cli.outputs import Output, Quantities, maybe, said
from adaptsim_cli.outputs.trials import UNITS
from hw.records import Record


class WorldRow(Record):
    """One world of the simulated lab."""

    name: str = said("its name")
    task: str = said("which task")
    description: str = said("one sentence")
    physics: str = said("drake or mujoco")


class Described(Record):
    """One parameter, context, action or nuisance of a task."""

    name: str = said("its name")
    plain_name: str = said("its plain name")
    unit: str = said("its unit; empty for a plain number")
    meaning: str = said("what it is, in one line")
    low: float = said("lower end of its range")
    high: float = said("upper end of its range")


class Worlds(Output):
    """The worlds of a task, and the meaning of its quantities."""

    worlds: list[WorldRow] = said("one each")
    quantities: list[Described] = said("parameters, contexts, actions and nuisance of the task")


class WorldOutput(Output):
    """The hidden values of a world. A session never sees them."""

    task: str = said("which task")
    world: str = said("which world")
    description: str = said("one sentence")
    physics: str = said("drake or mujoco")
    units: dict[str, str] = said(UNITS)
    parameters: Quantities = said("true parameters, in `units`")
    nuisance: Quantities = said("values that differ from trial to trial, in `units`")
    unmodelled: dict[str, Any] = said("effects that no parameter expresses")
    seed: int | None = maybe("seed of errors and noise; null for a world without an arm")
    sensing: dict[str, Any] | None = maybe("errors of camera and joints")
    mount: dict[str, Any] | None = maybe("errors of table and tool")
    faults: dict[str, Any] | None = maybe("faults, by trial")
    X_BC: list[list[float]] | None = maybe("true pose of the camera in the arm's base, 4 x 4, m")
    joint_zeros_rad: list[float] | None = maybe("true zeros of the joints")
    X_FT: list[list[float]] | None = maybe("true pose of the tool in the flange, 4 x 4, m")
    trials: list[dict[str, Any]] | None = maybe("place and motion of the object in every trial so far")


class CheckpointRow(Record):
    """One checkpoint."""

    task: str = said("its task; ? if its card cannot be read")
    name: str = said("its name")
    created: str = said("when it was made")
    folder: str = said("its folder")


class Checkpoints(Output):
    """The shipped checkpoints and the user's own."""

    checkpoints: list[CheckpointRow] = said("one each")


class Figure(Record):
    """One figure of a card."""

    name: str = said("what it is")
    card: float = said("value on the card")
    found: float = said("value by fresh rollouts")
    tolerance: float = said("by how much it may be worse")
    better: str = said("whether a larger or smaller value is better")
    holds: bool = said("whether the card is right about it")


class CheckpointVerified(Output):
    """A checkpoint against its card."""

    task: str = said("which task")
    folder: str = said("its folder")
    sha256: str = said("hash of its weights")
    holds: bool = said("whether the card is right about every figure")
    figures: list[Figure] = said("one each")


class Identifiable(Record):
    """How well sessions can identify one parameter."""

    name: str = said("its name")
    title: str = said("its plain name, with the unit")
    left: float = said("share of the error that remains after the trials; 1: they say nothing about it")
    words: str = said("the same in words")


class HeldOut(Record):
    """The error of an emulator by fresh rollouts."""

    rollouts: int = said("how many")
    accuracy: float = said("share of outcomes foretold")
    position_error_median: float = said("of the last observed position, in state units")
    end_state_error_median: float | None = maybe("of successes, in units; null without one")


class OwnObjectOutput(Output):
    """An own object: its file, its picture, its checkpoint."""

    object: str = said("its name")
    file: str = said("the TOML file")
    picture: str | None = maybe("PNG of the object in the lab; null for a task without an arm")
    inside: bool = said("whether the shipped emulator serves it as it is")
    checkpoint: str = said("folder of its checkpoint")
    held_out: HeldOut | None = maybe("the error of its emulator; null for a task that is solved exactly")
    parameters: list[Identifiable] = said("which of them a session can estimate")


class CheckpointParameters(Output):
    """Which parameters sessions can identify."""

    folder: str = said("of the checkpoint")
    task: str = said("which task")
    sessions: int = said("simulated targets")
    trials: int = said("trials in each")
    parameters: list[Identifiable] = said("one each")


class Pretrained(Output):
    """A checkpoint that was trained."""

    checkpoint: str = said("its folder")
    card: dict[str, Any] = said("its card, with the held-out results")


class BenchmarkOutput(Output):
    """Methods compared; [files](files.md#benchmarkjson) describes the rows field by field."""

    format: int = said("version of the results' files")
    task: str = said("which task")
    conditions: dict[str, Any] = said("trials of each session, and how policies were judged")
    trials: str = said("their source: simulated (true rollouts), tables (looked up), lab (arm and camera), recorded")
    recorded: str | None = maybe("hash of the recorded trials; absent: none were")
    held_out: float | None = maybe("share of the recorded trials that only scores")
    checkpoints: Any = said("checkpoints of the methods")
    targets: list[str] = said("worlds")
    seeds: int = said("sessions a world and method")
    left_out: dict[str, str] = said("methods that these checkpoints do not hold, and why")
    rows: list[dict[str, Any]] = said("one for a method, a world and a seed")
    summary: list[dict[str, Any]] = said("one for a set of worlds")
    report: str = said("page that was written")


class WorldTables(Output):
    """Tables of true rollouts that were made."""

    task: str = said("which task")
    tables: list[dict[str, Any]] = said("one a world")
