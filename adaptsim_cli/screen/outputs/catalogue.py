"""The output of each command, and its JSON schema.

The table here has a row for each command whose output no other code handles. The other commands have a class, and so
has each row inside an output.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import BaseModel

from adaptsim_cli.screen.outputs import (
    FOLDER,
    Output,
    Quantities,
    learning,
    optional,
    printed,
    rig,
    sessions,
    trials,
    unit_of,
)
from adaptsim_cli.screen.outputs.exchange import EXCHANGES, PolicyFile
from adaptsim_cli.screen.outputs.trials import UNITS
from hw.records import Record
from sim.adaptation.trials_forecast import TrialsForecast

SESSION, TASK, TRIAL = (str, "which session"), (str, "which task"), (int, "number of the trial, from 1")
PAGE, FILE = (str, "page that was written"), (str, "file that was written")
UNITS_OF = (dict[str, str], UNITS)

OUTPUTS: Mapping[str, type[Output]] = {
    "run-iteration": trials.IterationOutput,
    "pretrain": printed(
        "A checkpoint that was trained.",
        checkpoint=FOLDER,
        card=(dict[str, Any], "its card, with the held-out results"),
    ),
    "object": printed(
        "An own object: its file, its picture, its checkpoint.",
        object=(str, "its name"),
        file=(str, "the TOML file"),
        picture=(str | None, optional("PNG of the object in the lab; null for a task without an arm")),
        inside=(bool, "whether the shipped emulator serves it as it is"),
        checkpoint=(str, "folder of its checkpoint"),
        held_out=(
            learning.HeldOut | None,
            optional("the error of its emulator; null for a task that is solved exactly"),
        ),
        parameters=(list[learning.Identifiable], "which of them a session can estimate"),
    ),
    "benchmark": printed(
        "Methods compared; [files](files.md#benchmarkjson) describes the rows field by field.",
        format=(int, "version of the results' files"),
        task=TASK,
        conditions=(dict[str, Any], "trials of each session, and how policies were judged"),
        trials=(str, "their source: simulated (true rollouts), tables (looked up), lab (arm and camera), recorded"),
        recorded=(str | None, optional("hash of the recorded trials; absent without them")),
        held_out=(float | None, optional("fraction of the recorded trials held out for scoring")),
        checkpoints=(Any, "checkpoints of the methods"),
        targets=(list[str], "worlds"),
        seeds=(int, "sessions per world and method"),
        left_out=(dict[str, str], "methods that these checkpoints do not hold, and why"),
        rows=(list[dict[str, Any]], "one for a method, a world and a seed"),
        summary=(list[dict[str, Any]], "one for a set of worlds"),
        strata=(
            dict[str, Any] | None,
            optional("worlds in need of an action of their own and the others; absent: not sealed"),
        ),
        report=PAGE,
    ),
    "world-tables": printed(
        "Tables of true rollouts that were made.", task=TASK, tables=(list[dict[str, Any]], "one a world")
    ),
    "rollout": trials.Rollout,
    "preview": printed(
        "One planned motion.",
        task=TASK,
        arm=(str, "for which arm"),
        units=UNITS_OF,
        context=(Quantities, "context that it was planned for, in `units`"),
        action=(Quantities, "its action, in `units`"),
        duration_s=(list[float], "of approach, motion and return"),
        limits=(list[trials.Limit], "every limit of every path"),
    ),
    "parts": printed(
        "The parts that a lab prints.",
        sheet=(str, "PDF with drawings, and the patch at true size"),
        parts=(list[rig.PartFile], "each solid"),
    ),
    "report": printed("The page of a session.", session=SESSION, report=PAGE),
    "compare": printed(
        "Several sessions beside each other.",
        task=TASK,
        sessions=(list[dict[str, str | int | float]], "the rows of sessions.csv"),
        methods=(list[sessions.ComparedMethod], "one for each method"),
        identical=(list[list[str]], "groups of sessions that repeat each other, trial by trial"),
        posteriors=(list[sessions.ParameterBelief], "one for each session with a posterior and each parameter"),
        page=PAGE,
        tables=(list[str], "tables that were written"),
    ),
    "bundle": printed(
        "A session for a bug report.",
        session=SESSION,
        bundle=(str, "archive that was written"),
        files=(list[str], "its contents"),
    ),
    "doctor": printed(
        "The checklist.",
        ready=(bool, "whether an iteration can run"),
        hw=(str, "hardware that was checked: fake, panda, fr3 or fr3v2"),
        task=TASK,
        checks=(list[rig.CheckOutput], "one each"),
    ),
    "find": printed("The devices that this computer can reach.", devices=(list[rig.DeviceRow], "one each")),
    "retrack": printed(
        "Trials of a session, tracked again.",
        session=SESSION,
        units=UNITS_OF,
        trials=(list[sessions.RetrackedTrial], "one each"),
    ),
    "replay": printed(
        "A trial as a video or a Rerun file.",
        session=SESSION,
        trial=TRIAL,
        recording=(str, "the recording that it was made from"),
        written=FILE,
    ),
    "schema": printed("JSON schemas of outputs.", schemas=(dict[str, dict[str, Any]], "by command")),
    "calibrate": rig.CALIBRATION,
    "calibrate check": printed(
        "Three views against the calibration in use.",
        moved=(bool, "whether the camera was moved"),
        rms_px=(float, "residual of the three views"),
        limit_px=(float, "limit of the residual for a camera that has not moved"),
        moved_mm=(float, "distance of the camera from its calibrated position"),
        moved_deg=(float, "angle to its calibrated orientation"),
        sigma_mm=(float, "its uncertainty, one standard deviation"),
        sigma_deg=(float, "its uncertainty, one standard deviation"),
        X_BC_now=(rig.Matrix, "pose of the camera by these views, 4 x 4, m"),
        message=(str, "the comparison in one sentence"),
    ),
    "calibrate board": printed(
        "A printed calibration board.",
        file=PAGE,
        paper=(str, "size of the paper"),
        board=(dict[str, Any], "the board now in use, as in board.toml"),
        nominal_square_mm=(float, "side of a square as drawn"),
        measured=(bool, "whether its width was measured on the print"),
    ),
    "calibrate solve": rig.CALIBRATION,
    "calibrate together": printed(
        "Several cameras around one arm.",
        target=(str, "the checks"),
        size_sigma=(float | None, "difference from the stated size, in standard deviations"),
        held_out_px=(float | None, "residual of held-out views"),
        accepted=(bool, "whether every camera passed every gate"),
        weights=(str, "which of two fits was kept, and how both predict held-out views"),
        X_FM=(rig.Matrix, "pose of the target in the flange, 4 x 4, m"),
        cameras=(list[rig.CameraOutput], "one each"),
        file=FILE,
    ),
    "calibrate overlay": printed(
        "The arm drawn into pictures.",
        outline=(dict[str, Any] | None, "fit of the hand's outline; null if not measured"),
        sheet=(str, "some of the pictures side by side"),
        pictures=(dict[str, str], "the picture of every view"),
    ),
    "calibrate list": printed(
        "The calibrations of one rig, oldest first.",
        rig=(str, "which rig or world"),
        calibrations=(
            list[dict[str, Any]],
            "each with name, created, camera_m, sigma_mm, sigma_deg, views, in_use, restored_from, report; or with "
            "error",
        ),
        open_sessions=(list[str], "sessions that use the current one"),
    ),
    "calibrate show": rig.CALIBRATION,
    "calibrate restore": rig.RESTORED,
    "calibrate compare": printed(
        "Two calibrations beside each other.",
        first=(str, "name of the first"),
        second=(str, "name of the second"),
        moved_mm=(list[float], "from the camera's first position to its second, x, y, z in the base"),
        distance_mm=(float, "length of that"),
        turned_deg=(float, "angle between the two"),
        known_to_mm=(float, "uncertainty of the distance, one standard deviation"),
        known_to_deg=(float, "uncertainty of the angle, one standard deviation"),
        joint_zeros_mrad=(list[float], "joint zeros of the second minus those of the first"),
        camera_late_ms=(float, "delay of the camera's time stamps in the second minus that in the first"),
    ),
    "touch-off": rig.TOUCH_OFF,
    "touch-off list": printed(
        "The touch-offs of one rig and task, oldest first.",
        rig=(str, "which rig or world, and task"),
        touch_offs=(
            list[dict[str, Any]],
            "each with name, created, table_height_mm, tool_height_mm, tool_forward_mm, tool_pitch_deg, tool_roll_deg, "
            "touches, in_use, restored_from; or with error",
        ),
        open_sessions=(list[str], "sessions that use the current one"),
    ),
    "touch-off show": rig.TOUCH_OFF,
    "touch-off restore": rig.RESTORED,
    "touch-off compare": printed(
        "Two touch-offs beside each other.",
        first=(str, "name of the first"),
        second=(str, "name of the second"),
        quantities=(list[rig.ComparedValue], "one each"),
    ),
    "sessions list": printed(
        "All sessions, newest last.", sessions=(list[sessions.SessionRow | sessions.Damaged], "one each")
    ),
    "sessions show": sessions.SessionShown,
    "sessions index": printed("The page of all sessions.", page=PAGE, sessions=(int, "sessions on it")),
    "sessions verify": printed(
        "Sessions that were read from end to end.", sessions=(list[sessions.Verified], "one each")
    ),
    "sessions migrate": printed(
        "A session of an earlier format, written again in this version's.",
        session=(str, "the session that stays as it is"),
        migrated=(str, "name of the new one"),
        folder=FOLDER,
    ),
    "sessions redo": printed(
        "A trial that will be done again.",
        session=SESSION,
        trial=TRIAL,
        next_attempt=(int, "number of its next attempt, from 1"),
    ),
    "sessions accept": sessions.Amended,
    "sessions amend": sessions.Amended,
    "sessions mark": sessions.Marked,
    "sessions delete": printed("A session that was deleted.", session=SESSION, deleted=(bool, "true")),
    "sessions prune": sessions.PrunedRecordings,
    "sessions policy": printed(
        "The best policy of a session as a table.",
        format=(int, "version of the table"),
        session=SESSION,
        task=TASK,
        checkpoint=(str, "checkpoint that it was trained with"),
        checkpoint_sha256=(str, "hash of the checkpoint's weights"),
        parameters=(Quantities, "parameters that it was trained for, in the units of `quantities`"),
        quantities=(
            dict[str, list[sessions.Quantity]],
            "the quantities in `parameters`, `context` and `action`, in order",
        ),
        contexts=(list[list[float]], "contexts over the whole area, in units"),
        actions=(list[list[float]], "the policy's action at each, in units"),
        policies=(
            list[PolicyFile] | None,
            optional("the trained policy of each action, for a task that trains its policies"),
        ),
    ),
    "sessions export": printed(
        "Trials in the format of another program.",
        session=SESSION,
        format=(str, "which format"),
        written=(list[str], "files and folders that were written"),
    ),
    "checkpoints list": printed(
        "The shipped checkpoints and the user's own.", checkpoints=(list[learning.CheckpointRow], "one each")
    ),
    "checkpoints verify": printed(
        "A checkpoint compared with its card.",
        task=TASK,
        folder=FOLDER,
        sha256=(str, "hash of its weights"),
        holds=(bool, "whether the card is right about every figure"),
        figures=(list[learning.Figure], "one each"),
    ),
    "checkpoints parameters": printed(
        "The parameters that sessions can identify.",
        folder=(str, "of the checkpoint"),
        task=TASK,
        sessions=(int, "simulated targets"),
        trials=(int, "trials in each"),
        parameters=(list[learning.Identifiable], "one each"),
    ),
    "checkpoints trials": printed(
        "How many trials a session will need.",
        folder=(str, "of the checkpoint"),
        is_kept=(bool, "whether it was kept there, and sessions show it"),
        forecast=(TrialsForecast, "by sessions in imagined worlds"),
    ),
    "config show": printed(
        "Every setting with its origin.",
        settings=(dict[str, rig.Setting], "by name, as in adaptsim.toml"),
        rig_file=(dict[str, Any] | None, "contents of the rig file; null without one"),
    ),
    "config path": printed(
        "Where data and settings lie.",
        data=(str, "folder of all data"),
        user_file=(str, "settings of the user"),
        project_file=(str, "settings of this folder"),
        trust_file=(str, "files of current folders that a person has confirmed"),
    ),
    "lab list": printed(
        "The worlds of a task, and the meaning of its quantities.",
        worlds=(list[learning.WorldRow], "one each"),
        quantities=(list[learning.Described], "parameters, contexts, actions and nuisance of the task"),
    ),
    "lab show": printed(
        "The hidden values of a world. A session never sees them.",
        task=TASK,
        world=(str, "which world"),
        description=(str, "one sentence"),
        physics=(str, "the simulator that it runs in"),
        units=UNITS_OF,
        parameters=(Quantities, "true parameters, in `units`"),
        nuisance=(Quantities, "values that differ from trial to trial, in `units`"),
        unmodelled=(dict[str, Any], "effects that no parameter expresses"),
        seed=(int | None, optional("seed of errors and noise; null for a world without an arm")),
        sensing=(dict[str, Any] | None, optional("errors of camera and joints")),
        mount=(dict[str, Any] | None, optional("errors of table and tool")),
        faults=(dict[str, Any] | None, optional("faults, by trial")),
        X_BC=(list[list[float]] | None, optional("true pose of the camera in the arm's base, 4 x 4, m")),
        joint_zeros_rad=(list[float] | None, optional("true zeros of the joints")),
        X_FT=(list[list[float]] | None, optional("true pose of the tool in the flange, 4 x 4, m")),
        revealed=(learning.Revealed | None, optional("truth, range and belief of the newest session in this world")),
        trials=(list[dict[str, Any]] | None, optional("place and motion of the object in every trial so far")),
    ),
    "task new": printed("The file of a new task.", file=(str, "its path")),
    "task check": printed(
        "The rules that a task keeps. It is printed also if something is broken; the exit code is then 2.",
        task=(str, "its name"),
        file=(str | None, optional("the file that declares it; null: a package")),
        sound=(bool, "whether nothing is broken"),
        findings=(list[learning.CheckedFinding], "one each"),
        rollouts=(int, "how many different rollouts were simulated"),
        median_s=(float | None, optional("median time of a rollout")),
        longest_s=(float | None, optional("longest time of a rollout")),
    ),
    "task show": printed(
        "The interface of a task.",
        task=(str, "its name"),
        title=(str, "what is done in it"),
        file=(str | None, optional("the file that declares it; null: a package")),
        sha256=(str | None, optional("of the content of the file")),
        physics=(str, "the simulator that runs it"),
        fingerprint=(str, "of its ranges, names and units: a checkpoint must have the same"),
        duration_s=(float, "of a trial"),
        times_s=(list[float], "the observed moments"),
        state=(list[tuple[str, float, float]], "name with unit, lower end and upper end of each observed column"),
        parameters=(list[dict[str, Any]], "name, unit, low, high and scale of each; a category has its words"),
        margin=(list[dict[str, Any]], "the wider ranges from which datasets are drawn"),
        context=(list[dict[str, Any]], "as parameters"),
        action=(list[dict[str, Any]], "as parameters"),
        nuisance=(list[dict[str, Any]], "as parameters"),
        worlds=(list[str], "names of its worlds"),
    ),
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
