"""Rows of a long benchmark, stored one per line as soon as they are made, so that a stopped run can continue."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any


class Kept:
    """Rows that are in the file already are not made again. Without a file every row is made and none is kept.

    A line that a stop cut off half-way is dropped. It does not notice rows that earlier code has made: begin a new file
    after a change.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._rows: dict[tuple[str, int], dict[str, Any]] = {}
        if path is None or not path.exists():
            return
        for line in path.read_text().splitlines():
            try:
                found = json.loads(line)
            except json.JSONDecodeError:
                continue
            self._rows[found["case"], found["seed"]] = found["row"]
        path.write_text("".join(self._line(*key) for key in self._rows))

    def row(self, case: str, seed: int, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """The row of one case and seed, made now if it is not there."""
        key = (case, seed)
        if key not in self._rows:
            self._rows[key] = make()
            if self._path is not None:
                with self._path.open("a") as file:
                    file.write(self._line(*key))
        return self._rows[key]

    def knows(self, case: str, seed: int) -> bool:
        """Whether the row of this case and seed is there."""
        return (case, seed) in self._rows

    def _line(self, case: str, seed: int) -> str:
        return json.dumps({"case": case, "seed": seed, "row": self._rows[case, seed]}, default=_plain) + "\n"


def _plain(value: Any) -> Any:
    """A number of NumPy as one of Python."""
    return value.item()
