"""How a key of the rig file is described: its help, its unit, and its rules."""

from __future__ import annotations

from typing import Any

from pydantic import ConfigDict, Field

RULES = ConfigDict(extra="forbid", allow_inf_nan=False)


def key(meaning: str, unit: str = "", **rules: Any) -> Any:
    """The help text of a key, its unit, and pydantic's rules for it."""
    return Field(description=meaning, json_schema_extra={"unit": unit} if unit else None, **rules)
