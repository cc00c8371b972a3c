"""The base of all records, and the policy by which they outlive a version of the program (decision 13).

A record is a table in a file, or the output of a command. The program that reads a file may be older than the one that
wrote it. There are two kinds of files:

* Records that a program writes. An unknown key is an addition of a newer version (`from_any_version`): it is ignored,
  written back when the record is written again (`content_of`), and named by `additions`. It is never called damage.
  Nor is a new word of an enumeration with a member `UNKNOWN`, as which it is read.
* Files that people write: rigs, worlds, objects, manifests, views from elsewhere. An unknown key is a typing error, or
  a safeguard that this version would ignore. It is refused.

A key that goes, or that gets another meaning, raises the file's `format`. A newer format is refused in both kinds.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any, Self, TypeVar

from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, PrivateAttr, ValidationInfo, model_validator

AnyRecord = TypeVar("AnyRecord", bound="Record")

_ANY_VERSION = "any version"
UNKNOWN = "unknown"
"""The member of an enumeration as which a word of a newer version is read."""


class Record(BaseModel):
    """A frozen table of finite numbers, texts and further tables. Making one with an unknown key is an error.

    It can be validated from an object with the same attributes; further attributes of that object are ignored.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        from_attributes=True,
        json_schema_serialization_defaults_required=True,
        defer_build=True,  # until the first use, because most commands use few records
    )

    _additions: dict[str, Any] = PrivateAttr(default_factory=dict)

    @model_validator(mode="wrap")
    @classmethod
    def _set_additions_aside(cls, table: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        if info.context != _ANY_VERSION or not isinstance(table, Mapping):
            return handler(table)
        own = {key: value for key, value in table.items() if key in cls.model_fields}
        words = {key: value for key, value in own.items() if _is_new_word(cls.model_fields[key].annotation, value)}
        record = handler({**own, **dict.fromkeys(words, UNKNOWN)})
        record._additions.update({key: value for key, value in table.items() if key not in cls.model_fields} | words)
        return record

    def view(self, kind: type[AnyRecord]) -> AnyRecord:
        """The fields of `kind` that this record has, as a `kind`."""
        return kind(**{name: getattr(self, name) for name in kind.model_fields if hasattr(self, name)})

    @property
    def additions(self) -> tuple[str, ...]:
        """The keys, `outer.inner`, that a newer version wrote into this record and its tables."""
        inner = [f"{name}.{key}" for name in type(self).model_fields for key in _additions_of(getattr(self, name))]
        return (*self._additions, *inner)


class HandWritten(Record):
    """A table that a person writes: a number in quotes is an error too."""

    model_config = ConfigDict(strict=True)


def number_hint(value: object) -> str:
    """The way to write a number that is given as a text, with a point and without quotes; "" for any other value."""
    if not isinstance(value, str):
        return ""
    try:
        float(number := value.strip().replace(",", "."))
    except ValueError:
        return ""
    point = "with a point, not a comma, and " if "," in value else ""
    return f": write {number} instead of {value!r}, {point}without quotes"


def from_any_version(kind: type[AnyRecord], table: Mapping[str, Any]) -> AnyRecord:
    """The record in a table that this version, or a newer one of the same format, wrote.

    Raises pydantic's ValidationError for every defect except unknown keys. A field of several kinds of record needs a
    discriminator, since each kind would ignore the keys of the others.
    """
    return kind.model_validate(table, context=_ANY_VERSION)


def content_of(record: Record) -> dict[str, Any]:
    """The table of a record for its file, with the additions that were read."""
    table = _with_additions(record, record.model_dump(mode="json"))
    assert isinstance(table, dict)
    return table


def _is_new_word(kind: object, value: object) -> bool:
    """Whether an enumeration of words allows for later ones, and this is one."""
    if not (isinstance(kind, type) and issubclass(kind, StrEnum) and isinstance(value, str)):
        return False
    words = {word.value for word in kind}
    return UNKNOWN in words and value not in words


def _additions_of(value: object) -> list[str]:
    if isinstance(value, Record):
        return list(value.additions)
    if isinstance(value, Mapping):
        value = tuple(value.values())
    if isinstance(value, tuple):
        return list(dict.fromkeys(key for entry in value for key in _additions_of(entry)))
    return []


def _with_additions(value: object, dumped: Any) -> Any:
    if isinstance(value, Record):
        fields = {name: _with_additions(getattr(value, name), inner) for name, inner in dumped.items()}
        return {**fields, **value._additions}
    if isinstance(value, Mapping):
        return {key: _with_additions(value[key], inner) for key, inner in dumped.items()}
    if isinstance(value, tuple):
        return [_with_additions(entry, inner) for entry, inner in zip(value, dumped, strict=True)]
    return dumped
