"""Reads a rig file and names its gaps. Before a real arm moves, each gap has to be filled or waived; trials record
which.

An error names file, key, value, unit and limit; for an unknown key it lists the known ones.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import typing
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from pydantic import TypeAdapter, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from adaptsim_cli.bench.rig_file.description import RigDescription, as_shipped
from adaptsim_cli.bench.rig_file.waivers import Waivable, WaiverPart
from adaptsim_cli.config import PRACTICE_FILE, Config
from adaptsim_cli.errors import UsageError, plain, unknown
from hw.bounded import Unreadable, read_table

BOARD = "board"
"""[tools.board]: the calibration board in the gripper, for its payload."""

OLD_WAIVERS = "waived"
"""The key of an older version."""

_UNKNOWN = "unexpected_keyword_argument"
_LIMITS = {
    "greater_than_equal": "at least {ge}",
    "greater_than": "above {gt}",
    "less_than_equal": "at most {le}",
    "less_than": "below {lt}",
    "multiple_of": "a multiple of {multiple_of}",
    "string_too_short": "not empty",
    "string_pattern_mismatch": "only letters, digits, dots, - and _",
    "literal_error": "one of {expected}",
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "finite_number": "a finite number",
    "string_type": "a text in quotes",
    "tuple_type": "a list of numbers",
    "dataclass_type": "a table",
    "dict_type": "a table",
}


OWN_ROBOT = (
    "hw = own: your robot belongs to your code, so it has no rig file, calibration or touch-off here. "
    "Its trials: adaptsim run-iteration --hw own --answer-with person (docs/guide/own-robot.md)"
)


def practised(config: Config) -> bool:
    """Whether the simulated lab has a rig file: that of a setup which is practised there."""
    return config.is_simulated and Path(config.rig).name == PRACTICE_FILE


def rig_of(config: Config, tools: Collection[str] = ()) -> RigDescription:
    """The lab of the settings. Raises UsageError if a real arm has no rig file, or one for another arm."""
    if config.is_simulated:
        return read(Path(config.rig), tools) if practised(config) else as_shipped("panda")
    if config.is_own:
        raise UsageError(OWN_ROBOT)
    begin = f"adaptsim setup --hw {config.hw}"
    if not config.rig:
        raise UsageError(f"hw = {config.hw}: there is no rig file, so nothing has moved. Write one: {begin}")
    rig = read(Path(config.rig), tools)
    if not config.rig_is_own:
        rig = of_current_folder(rig, Path(config.rig))
    if rig.arm.model != config.hw:
        raise UsageError(
            f"hw = {config.hw}, but {config.rig} belongs to a lab with arm.model = {rig.arm.model!r}, so nothing has "
            f"moved. Say --hw {rig.arm.model}, or name another rig file with the setting rig; to write one: {begin}"
        )
    return rig


def of_current_folder(rig: RigDescription, path: Path) -> RigDescription:
    """The lab of a rig file that is not the user's own. Its waivers do not count, and its name follows from `path`.

    So it shares neither memory nor calibrations with a lab of the user's own file.
    """
    place = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:12]
    return dataclasses.replace(rig, name=f"{rig.name}.{place}", waivers=())


def tasks_with_tools() -> tuple[str, ...]:
    """The tasks that an arm can do."""
    from sim.tasks import get_task, task_names

    return tuple(name for name in task_names() if get_task(name).hardware is not None)


def read(path: Path, tools: Collection[str] = ()) -> RigDescription:
    """The lab that a file describes; `tools` names the tasks that may have a tool (empty: not checked).

    Raises UsageError naming the file and its first error.
    """
    try:
        content = read_table(path)
    except FileNotFoundError as error:
        raise UsageError(f"there is no rig file {path}. Write one: adaptsim setup --hw fr3") from error
    except Unreadable as error:
        raise UsageError(f"rig file {path} {error}") from error
    return described(content, str(path), tools)


def without_old_waivers(path: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The content of a file for a setup, without the list of waivers of an older version, and the names in it.

    Raises FileNotFoundError, UsageError.
    """
    try:
        content = read_table(path)
    except Unreadable as error:
        raise UsageError(f"rig file {path} {error}") from error
    names = content.pop(OLD_WAIVERS, ())
    return content, tuple(map(str, names)) if isinstance(names, (list, tuple)) else (str(names),)


def described(content: dict[str, Any], source: str, tools: Collection[str] = ()) -> RigDescription:
    """The lab of a parsed file. Raises UsageError beginning with `source`."""
    if OLD_WAIVERS in content:
        raise UsageError(
            f"{source}: {OLD_WAIVERS} is a list of an older version. A waiver now has a reason, a name and a day, and "
            "counts for 30 days. adaptsim setup removes the list and asks again about each entry; for one of them "
            "alone: adaptsim setup --waive NAME (docs/guide/rig.md#waivers)"
        )
    try:
        rig = TypeAdapter(RigDescription).validate_json(json.dumps(content, default=str), strict=True)
    except ValidationError as error:
        errors = sorted(error.errors(include_url=False), key=lambda detail: detail["type"] != _UNKNOWN)
        raise UsageError(f"{source}: {_explained(errors[0])}") from error  # a mistyped key comes before the missing key
    for name in rig.tools:
        if tools and name not in (*tools, BOARD):
            raise UsageError(f"{source}: {unknown(f'tools.{name}', name, (*tools, BOARD), 'Tools')}")
    return rig


def flat(content: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """(key, value) of every entry that a file states, for the screen."""
    for name, value in content.items():
        key = f"{prefix}{name}"
        if isinstance(value, dict):
            yield from flat(value, f"{key}.")
        elif isinstance(value, (list, tuple)) and value and isinstance(value[0], dict):
            for entry in value:
                yield from flat(entry, f"{key}.")
        elif value is not None:
            yield key, str(value) or '""'


def _explained(error: ErrorDetails) -> str:
    loc = error["loc"]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc).lstrip(".")
    kind, value = error["type"], error["input"]
    if kind == _UNKNOWN:
        owner = _class_at(loc[:-1])
        keys = tuple(field.name for field in dataclasses.fields(owner)) if owner else ()
        return unknown(key, str(loc[-1]), keys, "Known keys" + (f" of [{key.rpartition('.')[0]}]" if loc[:-1] else ""))
    field = _field_at(loc)
    help_text = f" ({field.description})" if field is not None and field.description else ""
    if kind == "missing" and isinstance(loc[-1], int):
        return (
            f"{key.rpartition('[')[0]} has {loc[-1]} value{'s' if loc[-1] != 1 else ''}, more belong there{help_text}"
        )
    if kind == "too_long":
        return f"{key} has {error['ctx']['actual_length']} values, {error['ctx']['max_length']} belong there{help_text}"
    if kind == "missing":
        return f"{key} is missing{help_text}"
    if kind == "value_error":
        return f"{key + ': ' if key else ''}{error['ctx']['error']}"
    requirement = _LIMITS.get(kind, plain(error["msg"])).format(**error.get("ctx", {}))
    return f"{key} = {json.dumps(value, ensure_ascii=False)}{_unit(field)}: it must be {requirement}{help_text}"


def _unit(field: FieldInfo | None) -> str:
    extra = field.json_schema_extra if field is not None else None
    return f" {extra['unit']}" if isinstance(extra, dict) and "unit" in extra else ""


def _field_at(loc: tuple[int | str, ...]) -> FieldInfo | None:
    """The field at a place in the file; an entry of a list belongs to the list's field."""
    while loc and isinstance(loc[-1], int):
        loc = loc[:-1]
    owner = _class_at(loc[:-1]) if loc else None
    return fields_of(owner).get(str(loc[-1])) if owner else None


def _class_at(loc: tuple[int | str, ...]) -> type | None:
    """The dataclass at a place in the file."""
    here: type | None = RigDescription
    inside_dict = False
    for part in loc:
        if isinstance(part, int) or inside_dict:  # an entry of a list, or a name that the user chose
            inside_dict = False
            continue
        if here is None or part not in fields_of(here):
            return None
        annotation = fields_of(here)[part].annotation
        inside_dict = typing.get_origin(annotation) is dict
        here = next(_dataclasses_in(annotation), None)
    return here


def fields_of(kind: type) -> dict[str, FieldInfo]:
    """Help, unit and limits of every key of a part of the file."""
    fields: dict[str, FieldInfo] = kind.__pydantic_fields__  # type: ignore[attr-defined]
    return fields


def _dataclasses_in(annotation: Any) -> Iterator[type]:
    if isinstance(annotation, type) and dataclasses.is_dataclass(annotation):
        yield annotation
    for inner in get_args(annotation):
        yield from _dataclasses_in(inner)


@dataclass(frozen=True)
class Gap:
    """Something that is neither stated nor waived."""

    what: Waivable
    message: str  # what is missing
    remedy: str


def gaps(rig: RigDescription, tool: str) -> tuple[Gap, ...]:
    """The gaps of a rig whose hand holds the tool `tool`, most important first."""
    lapsed = {waiver.safeguard: waiver for waiver in rig.lapsed()}
    stated: tuple[tuple[Waivable, bool, str, str], ...] = (
        (
            "pedal",
            rig.pedal is not None or rig.is_simulated,
            "it names no enabling pedal",
            "write its port into [pedal] (docs/guide/enable-pedal.md)",
        ),
        (
            "person",
            rig.person is not None,
            "it does not say where the operator stands, so the arm may move there",
            "write [person] with side and from_m",
        ),
        (
            "payload",
            rig.tool(tool).payload is not None,
            f"it gives no payload for the {tool} tool, so the arm takes its weight for a push",
            f"write [tools.{tool}.payload] with mass_kg and com_F_m",
        ),
        (
            "keep_out",
            bool(rig.keep_out),
            "it names no box that the arm must keep out of",
            "write a [[keep_out]] for each obstacle: stand, lamp, screen",
        ),
        (
            "hand",
            "hand" not in lapsed,
            "it does not say any more that the tool is screwed on",
            "let the hand hold the tool and remove its [[waivers]]",
        ),
    )
    return tuple(
        Gap(what, says + _lapsed(lapsed.get(what)), remedy)
        for what, is_there, says, remedy in stated
        if not (is_there or rig.waives(what))
    )


def _lapsed(waiver: WaiverPart | None) -> str:
    if waiver is None:
        return ""
    return f" (its waiver of {waiver.on} ended on {waiver.until}; adaptsim setup asks for the reason again)"


def in_words(open_gaps: tuple[Gap, ...]) -> str:
    """The gaps in one sentence."""
    return "; ".join(f"{gap.message}: {gap.remedy}" for gap in open_gaps)
