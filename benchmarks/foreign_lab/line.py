"""Asking the arm's process, from another one."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any


class Line:
    """Asks the arm's process."""

    def __init__(self, folder: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.connect(str(folder / "arm.sock"))
        self._file = self._socket.makefile("rw")

    def ask(self, **order: Any) -> dict[str, Any]:
        self._file.write(json.dumps(order) + "\n")
        self._file.flush()
        answer: dict[str, Any] = json.loads(self._file.readline())
        return answer
