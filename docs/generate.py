"""Write the pages of the documentation that follow from the code: `make docs`.

    python docs/generate.py            write them
    python docs/generate.py --check    exit code 1 if a committed page is out of date

Commands come from the Typer app, file formats from the models that read and write them, parameters and actions from
the tasks, and messages from the `raise` statements of every documented error.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from adaptsim_cli import app
from sim.tasks import TASKS, get_task
from sim.types import Dimension

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PACKAGES = ("adaptsim_cli", "calib", "hw", "perception", "sim")

Entry = tuple[str, str]

# --- commands ---------------------------------------------------------------------------------------------------------

COMMANDS_HEAD = """# Commands

Written by `make docs` from the program itself; `--help` of each command prints the same.

Settings come from the flag, else `ADAPTSIM_<KEY>`, else the project's `adaptsim.toml`, else the user's settings, else the
default. `adaptsim config show` prints every setting with its origin; [files](files.md#adaptsimtoml) lists them.

`--json` prints data on stdout and everything else on stderr; [JSON output](json.md) describes it.
`NO_COLOR` and `TERM=dumb` are obeyed. `adaptsim --debug` before a command shows the traceback of an error.
"""


def commands() -> str:
    """One section a command: what it does, usage, arguments, options, example."""
    parts = [COMMANDS_HEAD, "## Exit codes\n", _exit_codes()]
    for name, command in _walk(typer.main.get_command(app.app), "adaptsim"):
        parts.append(_command(name, command))
    return "\n".join(parts)


def _exit_codes() -> str:
    found = re.findall(r"(\d+) ([^,.]+)", app.EXIT_CODES)
    return "\n".join(["| code | meaning |", "|---|---|", *(f"| {code} | {words} |" for code, words in found), ""])


def _walk(node: Any, name: str) -> Iterator[tuple[str, Any]]:
    for word, command in node.commands.items():
        if hasattr(command, "commands"):
            if command.invoke_without_command:
                yield f"{name} {word}", command
            yield from _walk(command, f"{name} {word}")
        else:
            yield f"{name} {word}", command


def _command(name: str, command: Any) -> str:
    text, _, example = inspect.cleandoc(command.help or "").partition("Example: ")
    arguments = [p.name.upper() for p in command.params if _is_argument(p)]
    rows = [_option(p) for p in command.params if p.name != "help"]
    lines = [f"## {name}\n", f"`{' '.join([name, *arguments])}`\n", _joined(text) + "\n"]
    if rows:
        lines += ["| option | default | meaning |", "|---|---|---|", *rows, ""]
    if example:
        lines += ["```sh", example.strip(), "```", ""]
    return "\n".join(lines)


def _is_argument(parameter: Any) -> bool:
    return not parameter.opts[0].startswith("-")


def _joined(text: str) -> str:
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.strip().split("\n\n"))


def _option(parameter: Any) -> str:
    flags = [parameter.name.upper()] if _is_argument(parameter) else [*parameter.opts, *parameter.secondary_opts]
    shown = ", ".join(f"`{flag}`" for flag in sorted(flags, key=len, reverse=True))
    kind = {int: "N", float: "NUMBER", str: "TEXT", Path: "PATH"}.get(parameter.type_descriptor.annotation)
    if kind and not _is_argument(parameter):
        shown += f" {kind}"
    default = parameter.default
    plain = default in (None, False, "", ()) or callable(default)
    return f"| {shown} | {'' if plain else f'`{default}`'} | {_cell(parameter.help or '')} |"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


# --- parameters and actions -------------------------------------------------------------------------------------------

PARAMETERS_HEAD = """# Parameters and actions

Written by `make docs` from the tasks. What each word means: [glossary](../start/glossary.md). A session, a world file and
`--param`, `--action`, `--context` use the short names in the first column.

* **Simulation parameters** span Ω. The *margin* is how far the simulator has been tried beyond it.
* A **context** is what a task policy sees before a trial, an **action** what it chooses.
* A **nuisance** differs from trial to trial; nobody chooses it, and the policy does not know it.
"""


def parameters() -> str:
    """One section a task, one table a space."""
    parts = [PARAMETERS_HEAD]
    for name in TASKS:
        task = get_task(name)
        parts.append(f"## {name}\n\n{task.title[0].upper()}{task.title[1:]}.\n")
        margin = dict(zip(task.margin.names, task.margin.dimensions, strict=True))
        for title, space in (
            ("Simulation parameters", task.parameters),
            ("Context", task.context),
            ("Action", task.action),
            ("Nuisance", task.nuisance),
        ):
            if not len(space):
                continue
            wide = space is task.parameters
            parts += [
                f"### {title} of {name}\n",
                f"| name | plain name | range |{' margin |' if wide else ''} meaning |",
            ]
            parts.append("|---|---|---|---|" + ("---|" if wide else ""))
            for dimension in space.dimensions:
                if not (dimension.plain and dimension.meaning):
                    raise SystemExit(f"{name}: {dimension.name} has no plain name or no meaning: give it both")
                more = f" {_range(margin[dimension.name])} |" if wide else ""
                parts.append(
                    f"| `{dimension.name}` | {dimension.plain} | {_range(dimension)} |{more} {dimension.meaning} |"
                )
            parts.append("")
    return "\n".join(parts)


def _range(dimension: Dimension) -> str:
    scale = {"linear": "", "log": ", logarithmic", "integer": ", whole"}[dimension.scale]
    unit = f" {dimension.unit}" if dimension.unit else ""
    return f"{dimension.low:.4g} to {dimension.high:.4g}{unit}{scale}"


# --- file formats -----------------------------------------------------------------------------------------------------

FILES_HEAD = """# Files, field by field

Written by `make docs` from the models that read and write these files. Unknown keys are an error, in every file. Each file
is written whole or not at all. A field without a default must be given. [A session on disk](sessions.md) tells where each file of
a session lies and when it is written; [calibrate](../guide/calibrate.md#views-from-elsewhere) has examples of views.

Conventions: the end of a name is its unit (`_m`, `_rad`, `_s`, `_N`); `X_AB` is the pose of B in A, four rows of four; B is the arm's
base, F the flange, T the tool, C the colour camera, D the depth camera, M the board, H what holds the board. Times are ISO 8601.
"""

FILES: tuple[tuple[str, str, tuple[tuple[str, str, str], ...]], ...] = (
    (
        "adaptsim.toml",
        "Settings of a project folder, or of the user (`adaptsim config path`). Each key is also the variable `ADAPTSIM_<KEY>`.",
        (("", "adaptsim_cli.config", "_Values"),),
    ),
    (
        "rig.toml",
        "One lab with a real arm; [the rig file](../guide/rig.md) explains it.",
        (
            ("", "adaptsim_cli.devices.rig_file.description", "RigDescription"),
            ("[arm]", "adaptsim_cli.devices.rig_file.description", "ArmPart"),
            ("[arm.collision]", "adaptsim_cli.devices.rig_file.description", "Collision"),
            ("[table]", "adaptsim_cli.devices.rig_file.description", "TablePart"),
            ("[camera]", "adaptsim_cli.devices.rig_file.description", "CameraPart"),
            ("[pedal]", "adaptsim_cli.devices.rig_file.description", "PedalPart"),
            ("[balance]", "adaptsim_cli.devices.rig_file.description", "BalancePart"),
            ("[tools.TASK]", "adaptsim_cli.devices.rig_file.description", "ToolPart"),
            ("[tools.TASK.payload]", "adaptsim_cli.devices.rig_file.description", "PayloadPart"),
            ("[person]", "adaptsim_cli.devices.rig_file.description", "PersonPart"),
            ("[[keep_out]]", "adaptsim_cli.devices.rig_file.description", "KeepOutPart"),
        ),
    ),
    (
        "world.toml",
        "A world of the simulated lab; `adaptsim lab list` shows those that ship.",
        (
            ("", "sim.lab.world", "_File"),
            ("[unmodelled] of scooping", "sim.tasks.scooping.params", "Unmodelled"),
            ("[unmodelled] of pushing", "sim.tasks.pushing.params", "Unmodelled"),
            ("[sensing]", "sim.lab.world", "Sensing"),
            ("[mount]", "sim.lab.world", "Mount"),
            ("[faults]", "sim.lab.world", "Faults"),
        ),
    ),
    (
        "my-object.toml",
        "The ranges of your own object; [your own object](../guide/own-objects.md) explains it.",
        (("", "sim.tasks.own_object", "_File"),),
    ),
    (
        "session.toml",
        "What a session was begun with, and must be continued with.",
        (
            ("", "adaptsim_cli.session.records", "Facts"),
            ("[[parameters]], [[context]], [[action]]", "adaptsim_cli.session.records", "DimensionRecord"),
        ),
    ),
    ("start.json", "The first particles.", (("", "adaptsim_cli.session.records", "SessionStart"),)),
    (
        "motion.json",
        "A motion that is over, before anyone has looked at it.",
        (("", "adaptsim_cli.session.records", "MotionRecord"),),
    ),
    (
        "trial.json",
        "One completed trial.",
        (
            ("", "adaptsim_cli.session.records", "TrialRecord"),
            ("track", "adaptsim_cli.session.records", "TrackRecord"),
            ("moments", "adaptsim_cli.session.records", "KeyMoment"),
        ),
    ),
    ("rig.json", "Beside a trial on a real rig.", (("", "adaptsim_cli.session.records", "RigFacts"),)),
    (
        "result.json",
        "What the trials of one iteration led to.",
        (
            ("", "adaptsim_cli.session.records", "ResultRecord"),
            ("best", "adaptsim_cli.session.records", "BestRecord"),
        ),
    ),
    (
        "started.json, rejected.json, shown.json",
        "Markers of a session.",
        (("", "adaptsim_cli.session.records", "Note"),),
    ),
    (
        "setup.toml",
        "What all views of a calibration share.",
        (
            ("", "calib.records", "SetupRecord"),
            ("[poses]", "calib.pose_records", "PosesRecord"),
            ("[kinematics]", "calib.records", "KinematicsRecord"),
            ("[board]", "calib.target_records", "BoardRecord"),
            ("Of every kind of [board]", "calib.target_records", "TargetRecord"),
            ("A plain chessboard", "calib.target_records", "ChessboardRecord"),
            ("One marker", "calib.target_records", "MarkerRecord"),
            ("Markers in rows", "calib.target_records", "MarkerGridRecord"),
            ("Circles", "calib.target_records", "CirclesRecord"),
            ("Points found elsewhere", "calib.target_records", "PointsRecord"),
            ("[colour], [depth]", "calib.records", "IntrinsicsRecord"),
        ),
    ),
    (
        "view-NAME.json",
        "One view of the board, arm at rest.",
        (("", "calib.records", "ViewRecord"), ("How it tells the pose", "calib.pose_records", "PoseKeys")),
    ),
    ("touch.json", "One corner of the board, touched.", (("", "calib.records", "TouchRecord"),)),
    (
        "touch-off.json",
        "A stored touch-off.",
        (
            ("", "adaptsim_cli.touch_off.store", "SavedTouchOff"),
            ("every value with an interval", "adaptsim_cli.touch_off.store", "EstimateRecord"),
            ("touches", "adaptsim_cli.touch_off.store", "SlowTouchRecord"),
        ),
    ),
)

SAID = {
    "format": "version of the layout; a newer one is refused",
    "name": "its name",
    "unit": "its unit",
    "low": "lower end of its range",
    "high": "upper end of its range",
    "scale": "how it is normalised",
    "task": "which task",
    "hw": "which hardware moved",
    "world": "world of the simulated lab",
    "world_sha256": "hash of the world's file",
    "seed": "seed of all random numbers",
    "method": "how particles are updated",
    "particles": "particles, side by side",
    "checkpoint": "which checkpoint",
    "checkpoint_sha256": "hash of its weights",
    "calibration_sha256": "hash of the poses of camera and tool",
    "versions": "versions of Python and the main packages",
    "object_name": "how the screen calls the object",
    "parameters": "the simulation parameters, with ranges",
    "context": "context of the trial, in units",
    "action": "action that was commanded, in units",
    "t_s": "times, from the start of the tool's motion",
    "state": "a row for each time",
    "confidence": "between 0 and 1, for each time",
    "outcome": "how the trial ended",
    "flags": "what tracking or the end of the motion warned of",
    "file": "file beside this one",
    "drawn_context": "context that was asked for, before the camera measured",
    "predicted_reward": "expected reward",
    "predicted_low": "lower end of its interval",
    "predicted_high": "upper end of its interval",
    "timing_s": "seconds spent on each stage",
    "number": "number of the trial in the session, from 1",
    "attempt": "number of the attempt, from 0",
    "iteration": "number of the iteration, from 0",
    "particle": "number of the particle, from 0",
    "trial": "number of the trial of its particle, from 0",
    "observation": "positions at the task's times, normalised",
    "reward": "between 0 and 1",
    "overruled_from": "outcome that tracking had found, if the operator set another",
    "track": "the tracked object",
    "moments": "pictures kept for the report",
    "control_success_rate": "share of control cycles in time",
    "object_mass_kg": "mass that the balance gave",
    "params": "parameters by name, in units",
    "mean_reward": "estimated reward",
    "trials": "trials behind it",
    "ci95": "95 % interval",
    "next_particles": "particles of the next iteration",
    "best": "the parameters that the session would go with",
    "verdict": "one sentence on the session",
    "at": "when",
    "text": "why, in words",
    "squares_across": "squares in a row",
    "squares_down": "squares in a column",
    "square_mm": "side of a square, as measured on the print",
    "marker_mm": "side of a marker",
    "dictionary": "OpenCV's dictionary, without DICT_, in small letters",
    "width": "pixels across",
    "height": "pixels down",
    "camera": "`fixed` (the board moves with the arm) or `wrist` (the camera does)",
    "board": "the board",
    "colour": "the colour camera",
    "q_rad": "joints, as the arm reports them",
    "X_BF": "the flange in the base; joints or this",
    "quaternion_wxyz": "orientation of the flange, w first",
    "t_camera_s": "when the picture was taken",
    "t_arm_s": "when the joints were read, on the same clock",
    "sha256": "hash of each file; a truncated image is noticed",
    "corner": "number of the inner corner, along the upper row first, from 0",
    "value": "the value",
    "within": "half width of its 95 % interval",
    "place": "what was touched where",
    "created": "when",
    "arm": "which arm",
    "rig": "which rig",
    "tool": "which tool",
    "source": "what made it",
    "table_height_m": "table height under the work area",
    "tilt_x": "how much the table rises along X",
    "tilt_y": "how much the table rises along Y",
    "tool_height_m": "how much higher the tool sits than designed",
    "tool_forward_m": "how much further forward it sits",
    "tool_pitch_rad": "how much further its edge is pitched down",
    "tool_roll_rad": "how much further its left side is rolled up",
    "edge_over_table_m": "edge against table, 95 %",
    "repeat_m": "spread of touches of one place",
    "misfit_m": "largest distance of a place from what all others say",
    "slip_m": "how far a corner moved after pressing",
    "pressed_N": "force of the slip check",
    "grasp_force_N": "force with which the hand held the tool",
    "touches": "every slow touch",
    "description": "one sentence for `adaptsim lab list`",
    "nuisance": "what differs from trial to trial; left out: the middle",
    "unmodelled": "effects that no parameter expresses",
    "sensing": "errors of camera and joints",
    "mount": "errors of table and tool",
    "faults": "faults, by trial",
    "ranges": "[low, high] of each parameter that differs from the task's own",
    "camera_timeout": "trials in which the camera loses the recording",
    "arm_reflex": "trials in which the arm stops with a reflex",
    "pedal_release": "trials in which the pedal is released",
    "density_scale": "density, relative to training",
    "contact": "contact law",
    "bottle_mass_scale": "mass of the bottle, relative to training",
    "patch_size_scale": "side of the patch, relative to training",
    "started": "when the motion began",
    "summary_sha256": "hash of summary.json beside it",
    "extrinsic_error_mm": "how far off the nominal calibration is",
    "extrinsic_error_deg": "how far off the nominal calibration is turned",
    "weighed": "when it was weighed",
}
"""Field -> meaning, where the code has no comment beside it."""


def files() -> str:
    """One section a file, one table a part."""
    parts = [FILES_HEAD]
    for title, text, tables in FILES:
        parts.append(f"## {title}\n\n{text}\n")
        for heading, module, name in tables:
            if heading:
                parts.append(f"`{heading}`\n" if heading[0] == "[" and heading[-1] == "]" else f"{heading}:\n")
            parts += ["| field | type | default | meaning |", "|---|---|---|---|"]
            parts += [f"| `{f}` | {_cell(t)} | {d} | {_cell(m)} |" for f, t, d, m in fields(module, name)]
            parts.append("")
    return "\n".join(parts)


def fields(module: str, name: str) -> Iterator[tuple[str, str, str, str]]:
    """(field, type, default, meaning) of a model or dataclass, its meaning from comment, docstring or description."""
    source = textwrap.dedent(inspect.getsource(getattr(importlib.import_module(module), name)))
    lines = source.splitlines()
    body = ast.parse(source).body[0].body  # type: ignore[attr-defined]
    for node, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        field = node.target.id
        meaning, unit = _described(node)
        if not meaning and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            meaning = str(after.value.value)
        if not meaning and "  # " in (last := lines[(node.end_lineno or 1) - 1]):
            meaning = last.split("  # ", 1)[1].removeprefix("noqa").strip()
        if meaning in ("", "fmt: skip", "ISO 8601"):
            meaning = SAID.get(field, "")
        if not meaning:
            raise SystemExit(f"{module}.{name}.{field} says nowhere what it means: add a comment beside it")
        yield field, _type(node.annotation), _default(node.value), meaning + (f" ({unit})" if unit else "")


def _described(node: ast.AnnAssign) -> tuple[str, str]:
    """Description and unit of a pydantic field, as they stand in the source, or of its dataclass in `Annotated`."""
    text = unit = ""
    for call in ast.walk(node):
        if not isinstance(call, ast.Call):
            continue
        for keyword in call.keywords:
            if keyword.arg == "description" and isinstance(keyword.value, ast.Constant):
                text = str(keyword.value.value)
            if keyword.arg == "json_schema_extra" and isinstance(keyword.value, ast.Dict):
                unit = str(ast.literal_eval(keyword.value)["unit"])
        if isinstance(call.func, ast.Name) and call.func.id == "_touched":
            _, what, unit = (ast.literal_eval(a) for a in call.args)
            text = f"{what}, from the touch-off"
    return text, unit


def _type(node: ast.expr) -> str:
    if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "Annotated" and isinstance(node.slice, ast.Tuple):
        node = node.slice.elts[0]
    text = ast.unparse(node)
    for old, new in (
        ("tuple[Samples, ...]", "list of lists of vectors"),
        ("tuple[Row, ...]", "list of vectors"),
        ("dict[str, Any]", "table"),
        ("Numbers", "list of float"),
        ("Row", "vector"),
        ("Matrix", "rows"),
        ("str | None", "str"),
        (" | None", ""),
    ):
        text = text.replace(old, new)
    text = re.sub(r"\bHardware\b", "Literal['fake', 'panda', 'fr3']", text)
    text = re.sub(r"\bSide\b", "Literal['left', 'right', 'front', 'back']", text)
    text = re.sub(r"\b\w+(Part|Record|Collision)\b|\bCollision\b", "table", text)
    text = re.sub(r"tuple\[(\w+), \.\.\.\]", r"list of \1", text)
    text = re.sub(r"tuple\[(Three|Four)(, \1)+\]", lambda m: f"{m[1].lower()} rows of {m[1].lower()}", text)
    text = re.sub(r"tuple\[(float|int)(?:, \1)+\]", lambda m: f"{m[0].count(m[1])} {m[1]}", text)
    text = re.sub(r"tuple\[(\d \w+), \.\.\.\]", r"list of \1", text)
    for word, number in (("Range", 2), ("Three", 3), ("Six", 6), ("Seven", 7)):
        text = re.sub(rf"\b{word}\b", f"{number} float", text)
    text = re.sub(r"Literal\[(.*)\]", lambda m: " or ".join(m[1].split(", ")), text)
    return re.sub(r"dict\[str, (.*)\]", r"table of \1", text).replace("'", "`")


def _default(node: ast.expr | None) -> str:
    """The default as it stands in the source; a dash where the field must be given."""
    if node is None:
        return "–"
    if ast.unparse(node).startswith(("_", "tuple(")):
        return "the maker's"
    if isinstance(node, ast.Call):
        if any(k.arg == "default_factory" for k in node.keywords):
            return "all defaults"
        return f"`{ast.unparse(node.args[0])}`" if node.args else "–"
    text = ast.unparse(node)
    if text in ("()", "{}", "''", "None"):
        return "left out"
    return "`1`" if text == "FORMAT" else f"`{text}`"


# --- messages ---------------------------------------------------------------------------------------------------------

MESSAGES_HEAD = """# Troubleshooting by message

Written by `make docs` from the errors that the program raises. Search this page for a part of the message that you see; `…` stands
for a value. Every message ends with what to do; the same command continues the session. What to do beside the arm: [When something goes
wrong](faults.md).

The exit code of a command tells the kind of error:

| exit code | errors |
|---|---|
"""

ADVICE = {
    2: "Nothing was opened and nothing has moved. Correct the command, setting or file that the message names. `adaptsim config show` "
    "prints every setting with its origin.",
    3: "Nothing has moved, or the hand or the touch-off stopped by itself. `adaptsim doctor` with the same `--hw` lists what is missing, with "
    "the remedy of each.",
    4: "Nothing has moved. `adaptsim preview` with the same `--action` and `--context` shows which limit. Move the object, or the box that "
    "is in the way.",
    5: "The arm has stopped. Look at it and at what it touched, then run the same command: it shows the fault and asks for `recover`.",
    6: "The trial does not count; the recording is kept. Check camera, light and table, then run the same command.",
    7: "The operator stopped. Everything completed is stored; the same command continues.",
    8: "A file is damaged, missing or of another kind, or the disk is full. Nothing is repaired silently.",
    130: "Ctrl-C. Everything completed is stored; the same command continues.",
    1: "The simulation failed for another reason. Please report it with the output of `adaptsim --debug`.",
}
FEWEST_WORDS = 3
"""Shorter templates are only a value that is passed on."""


def messages() -> str:
    """Every documented error with its exit code, its meaning and its messages."""
    kinds = {kind.__name__: kind for kind in _error_classes()}
    found: dict[str, set[str]] = {name: set() for name in kinds}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            for name, text in _raised(ast.parse(path.read_text(encoding="utf-8"))):
                if name in found and len(text.replace("…", "").split()) >= FEWEST_WORDS:
                    found[name].add(text)
    by_code: dict[int, list[str]] = {}
    for name, kind in kinds.items():
        by_code.setdefault(app.exit_code(kind("")), []).append(name)
    parts = [MESSAGES_HEAD.rstrip()]
    parts += [
        f"| [{code}](#exit-code-{code}) | {', '.join(sorted(names))} |" for code, names in sorted(by_code.items())
    ]
    for code, names in sorted(by_code.items()):
        parts.append(f"\n## Exit code {code}\n\n{ADVICE[code]}")
        for name in sorted(names):
            if not found[name]:
                continue
            parts.append(f"\n### {name}\n\n{_first(kinds[name])}\n")
            parts += [f"* {_escaped(text)}" for text in sorted(found[name], key=str.lower)]
    return "\n".join(parts) + "\n"


def _error_classes() -> Iterator[type[Exception]]:
    documented = app.documented_errors()
    for package in PACKAGES:
        for value in vars(importlib.import_module(f"{package}.errors")).values():
            if inspect.isclass(value) and issubclass(value, documented) and value.__module__ == f"{package}.errors":
                yield value


def _first(kind: type[Exception]) -> str:
    return (inspect.getdoc(kind) or "").split("\n\n")[0].replace("\n", " ")


def _raised(tree: ast.AST) -> Iterator[Entry]:
    """(class, message) of every error that is made of a text in the source."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and node.args:
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            text = _template(node.args[0])
            if text:
                yield name, re.sub(r"(… ?)+…|…+", "…", " ".join(text.split())).strip()


def _template(node: ast.expr) -> str:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(v.value if isinstance(v, ast.Constant) else "…" for v in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return (_template(node.left) or "…") + (_template(node.right) or "…")
    return ""


def _escaped(text: str) -> str:
    return re.sub(r"([*_<>\[\]|])", r"\\\1", text.replace("`", ""))


PAGES = {
    DOCS / "reference/commands.md": commands,
    DOCS / "reference/parameters.md": parameters,
    DOCS / "reference/files.md": files,
    DOCS / "guide/troubleshooting.md": messages,
}


def stale() -> list[str]:
    """The committed pages that differ from what the code says now."""
    return [str(p.relative_to(ROOT)) for p, make in PAGES.items() if not p.is_file() or p.read_text("utf-8") != make()]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    if parser.parse_args().check:
        old = stale()
        print("\n".join(old) if old else "every page is current")
        return 1 if old else 0
    for path, make in PAGES.items():
        path.write_text(make(), encoding="utf-8")
        print(path.relative_to(ROOT))
    return 0


if __name__ == "__main__":
    sys.exit(main())
