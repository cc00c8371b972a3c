"""Asks a local server of pages as a browser does: contents, and its streams of events."""

from __future__ import annotations

import http.client
import json
from typing import Any

from adaptsim_cli.show.server import LocalServer


def get(server: LocalServer, path: str, host: str | None = None) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    connection.request("GET", path, headers={} if host is None else {"Host": host})
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, dict(answer.getheaders()), content


class Events:
    """The stream of states, one after the other."""

    def __init__(self, server: LocalServer, path: str = "/live/s/state") -> None:
        self._connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
        self._connection.request("GET", path)
        self._answer = self._connection.getresponse()

    def next(self) -> Any:
        """The next state; None where the session is over."""
        while True:
            line = self._answer.readline().decode().strip()
            if line == "event: over":
                return None
            if line.startswith("data: "):
                return json.loads(line.removeprefix("data: "))

    def close(self) -> None:
        self._answer.close()
        self._connection.close()
