"""Outputs of `adaptsim task`."""

from __future__ import annotations

from typing import Any

from adaptsim_cli.screen.outputs import Output, described, optional
from hw.records import Record


class TaskWritten(Output):
    """The file of a new task."""

    file: str = described("its path")


class CheckedFinding(Record):
    """One rule that a task keeps or breaks."""

    check: str = described("what every task keeps")
    mark: str = described("kept, doubtful or broken")
    detail: str = described("one sentence; empty if there is nothing to say")


class TaskChecked(Output):
    """The rules that a task keeps. It is printed also if something is broken; the exit code is then 2."""

    task: str = described("its name")
    file: str | None = optional("the file that declares it; null: a package")
    sound: bool = described("whether nothing is broken")
    findings: list[CheckedFinding] = described("one each")
    rollouts: int = described("how many different rollouts were simulated")
    median_s: float | None = optional("median time of a rollout")
    longest_s: float | None = optional("longest time of a rollout")


class TaskShown(Output):
    """The interface of a task."""

    task: str = described("its name")
    title: str = described("what is done in it")
    file: str | None = optional("the file that declares it; null: a package")
    sha256: str | None = optional("of the content of the file")
    physics: str = described("the simulator that runs it")
    fingerprint: str = described("of its ranges, names and units: a checkpoint must have the same")
    duration_s: float = described("of a trial")
    times_s: list[float] = described("the observed moments")
    state: list[tuple[str, float, float]] = described("name with unit, lower end and upper end of each observed column")
    parameters: list[dict[str, Any]] = described("name, unit, low, high and scale of each; a category has its words")
    margin: list[dict[str, Any]] = described("the wider ranges from which datasets are drawn")
    context: list[dict[str, Any]] = described("as parameters")
    action: list[dict[str, Any]] = described("as parameters")
    nuisance: list[dict[str, Any]] = described("as parameters")
    worlds: list[str] = described("names of its worlds")
