"""Writes a rig file with a comment at every key: meaning, unit, limits. Keys that are left out appear commented out."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Iterator
from typing import Any, get_args

import annotated_types
from pydantic.fields import FieldInfo

from adaptsim_cli.bench.rig_file.description import KeepOutPart, RigDescription
from adaptsim_cli.bench.rig_file.reading import fields_of

_HEAD = """\
# One lab with a real arm, for adaptsim (docs/guide/rig.md). Lengths are in metres, angles in rad, in the arm's base
# frame: X forward, Y to the left, Z up. Check what you write here with: adaptsim doctor
"""
_EXAMPLE_BOX = KeepOutPart("lamp", (0.5, -0.7, 0.4), (0.7, -0.5, 0.9))


def template(rig: RigDescription, tasks: tuple[str, ...]) -> str:
    """The text of a file that describes `rig`; `tasks` are those that may have a tool."""
    lines = [_HEAD, *_part(rig, "", commented=False)]
    for name, part in rig.devices.items():
        lines += _section(f"devices.{name}", part, commented=False)
    for tool in (*tasks, *(name for name in rig.tools if name not in tasks)):
        lines += _section(f"tools.{tool}", rig.tool(tool), commented=tool not in rig.tools)
    for box in rig.keep_out:
        lines += ["", "[[keep_out]]", *_part(box, "keep_out", commented=False)]
    if not rig.keep_out:
        lines += ["", "# a box that neither arm nor tool enters; one of these for each", "#[[keep_out]]"]
        lines += _part(_EXAMPLE_BOX, "keep_out", commented=True)
    for waiver in rig.waivers:
        lines += ["", "# a safeguard that this lab goes without for 30 days", "[[waivers]]"]
        lines += _part(waiver, "waivers", commented=False)
    return "\n".join(lines) + "\n"


def _part(part: Any, path: str, *, commented: bool) -> Iterator[str]:
    """The lines of a part: plain keys first, then its tables."""
    fields = fields_of(type(part))
    plain = [name for name, field in fields.items() if not _is_table(field)]
    for name in plain:
        value = getattr(part, name)
        shown = next(iter(fields[name].examples or ()), None) if value is None else value
        mark = "#" if commented or value is None else ""
        yield from (f"# {_told(fields[name])}", f"{mark}{name} = {_value(shown)}")
    for name, field in fields.items():
        if name in plain or name in ("devices", "tools", "keep_out", "waivers"):
            continue
        full = f"{path}.{name}".lstrip(".")
        kind = next(k for k in (field.annotation, *get_args(field.annotation)) if dataclasses.is_dataclass(k))
        value = getattr(part, name)
        shown = value if value is not None else next(iter(field.examples or ()), None) or _example(kind)
        yield from _section(full, shown, commented=commented or value is None)


def _section(full: str, part: Any, *, commented: bool) -> Iterator[str]:
    heading = (type(part).__doc__ or "").partition("\n")[0]
    yield from ("", f"# {heading}", f"{'#' if commented else ''}[{full}]")
    yield from _part(part, full, commented=commented)


def _example(kind: Any) -> Any:
    """An example of a part, from the examples of its required keys."""
    examples = {name: next(iter(field.examples)) for name, field in fields_of(kind).items() if field.examples}
    return kind(**examples)


def _is_table(field: FieldInfo) -> bool:
    kinds = (field.annotation, *get_args(field.annotation))
    return any(dataclasses.is_dataclass(kind) for kind in kinds) or typing.get_origin(field.annotation) is dict


def _told(field: FieldInfo) -> str:
    extra = field.json_schema_extra
    unit = f", {extra['unit']}" if isinstance(extra, dict) and "unit" in extra else ""
    low = next((rule.ge for rule in field.metadata if isinstance(rule, annotated_types.Ge)), None)
    high = next((rule.le for rule in field.metadata if isinstance(rule, annotated_types.Le)), None)
    return f"{field.description}{unit}" + (f", {low:g} to {high:g}" if low is not None and high is not None else "")


def _value(value: Any) -> str:
    """A value as TOML, on one line."""
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, tuple):
        return "[" + ", ".join(_value(entry) for entry in value) + "]"
    return str(value).lower() if isinstance(value, bool) else repr(value)
