"""The output model of each command, and its JSON schema."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import BaseModel

from adaptsim_cli.screen.outputs import Output, described, learning, rig, sessions, tasks, trials, unit_of
from adaptsim_cli.screen.outputs.exchange import EXCHANGES
from hw.records import Record


class Schemas(Output):
    """JSON schemas of outputs."""

    schemas: dict[str, dict[str, Any]] = described("by command")


OUTPUTS: Mapping[str, type[Output]] = {
    "run-iteration": trials.IterationOutput,
    "pretrain": learning.Pretrained,
    "object": learning.OwnObjectOutput,
    "benchmark": learning.BenchmarkOutput,
    "world-tables": learning.WorldTables,
    "rollout": trials.Rollout,
    "preview": trials.Preview,
    "parts": rig.PartsOutput,
    "report": sessions.Reported,
    "compare": sessions.Compared,
    "bundle": sessions.Bundled,
    "doctor": rig.Doctor,
    "find": rig.Devices,
    "retrack": sessions.Retracked,
    "replay": sessions.Replayed,
    "schema": Schemas,
    "calibrate": rig.Calibration,
    "calibrate check": rig.CalibrationCheck,
    "calibrate board": rig.BoardOutput,
    "calibrate solve": rig.Calibration,
    "calibrate together": rig.Cameras,
    "calibrate overlay": rig.Overlay,
    "calibrate list": rig.CalibrationList,
    "calibrate show": rig.Calibration,
    "calibrate restore": rig.Restored,
    "calibrate compare": rig.CalibrationsCompared,
    "touch-off": rig.TouchOff,
    "touch-off list": rig.TouchOffList,
    "touch-off show": rig.TouchOff,
    "touch-off restore": rig.Restored,
    "touch-off compare": rig.TouchOffsCompared,
    "sessions list": sessions.SessionList,
    "sessions show": sessions.SessionShown,
    "sessions index": sessions.IndexedSessions,
    "sessions verify": sessions.VerifiedSessions,
    "sessions migrate": sessions.MigratedSession,
    "sessions redo": sessions.Redone,
    "sessions accept": sessions.Amended,
    "sessions amend": sessions.Amended,
    "sessions mark": sessions.Marked,
    "sessions delete": sessions.Deleted,
    "sessions prune": sessions.PrunedRecordings,
    "sessions policy": sessions.Policy,
    "sessions export": sessions.Exported,
    "checkpoints list": learning.Checkpoints,
    "checkpoints verify": learning.CheckpointVerified,
    "checkpoints parameters": learning.CheckpointParameters,
    "checkpoints trials": learning.TrialsOutput,
    "config show": rig.Settings,
    "config path": rig.PlacesOutput,
    "lab list": learning.Worlds,
    "lab show": learning.WorldOutput,
    "task new": tasks.TaskWritten,
    "task check": tasks.TaskChecked,
    "task show": tasks.TaskShown,
}
"""The output of every command that takes `--json`."""


SCHEMAS: Mapping[str, type[Record]] = {**OUTPUTS, **EXCHANGES}
"""The outputs, and the records of questions to your own robot and of its answers."""


def output(command: str, value: Mapping[str, Any] | BaseModel) -> dict[str, Any]:
    """`value` as the output of `command`, with its version first.

    Raises ValidationError if it does not match the model.
    """
    return OUTPUTS[command].model_validate(value).model_dump(mode="json")


def schema(command: str) -> dict[str, Any]:
    """JSON schema of the output of `command`. A field gets the unit that its name ends with."""
    mode: Literal["serialization", "validation"] = "serialization" if command in OUTPUTS else "validation"
    document = SCHEMAS[command].model_json_schema(mode=mode)
    document["title"] = f"adaptsim {command} --json" if command in OUTPUTS else command
    for part in (document, *document.get("$defs", {}).values()):
        for name, field in part.get("properties", {}).items():
            if unit := unit_of(name):
                field["unit"] = unit
    return document
