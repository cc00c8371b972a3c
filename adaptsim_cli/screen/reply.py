"""The last output of a command, for a program or for a person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import BaseModel
    from rich.console import RenderableType

Step = tuple[str, str]
"""(next command, its reason)."""


@dataclass(frozen=True)
class Reply:
    """The result of a command. `Screen.end` prints it."""

    data: Mapping[str, Any] | BaseModel | None = None
    """The output with --json, an object of the command's model in `outputs/catalogue.py`; None if nothing is left to
    print."""
    text: Sequence[RenderableType] = ()
    """The same for a person, unless JSON is printed. A string stays on one line, so that paths can be copied."""
    next: Sequence[Step] = ()
    """The next commands for a person, the likeliest first."""
    failure: Exception | None = None
    """Raised after all is printed: the command ends with its exit code."""
