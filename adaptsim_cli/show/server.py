"""Serves one page on this computer. Its state goes out as server-sent events; nothing comes in.

An open page asks for the camera's newest picture.
"""

from __future__ import annotations

import errno
import json
import threading
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self
from urllib.parse import urlsplit

from adaptsim_cli.errors import UsageError

HOST = "127.0.0.1"
PORT = 8765
KEEP_ALIVE_S = 5.0
"""Time without news after which a comment is sent, to notice a closed page."""

_POLICY = (
    "default-src 'none'; img-src 'self' data:; connect-src 'self'; "
    "style-src 'unsafe-inline'; script-src 'unsafe-inline'"
)
_OURS = frozenset({"127.0.0.1", "localhost"})


class Page:
    """Serves `html` at `address`; open pages show every `show` at once."""

    def __init__(self, html: str, port: int | None = None, newest: Callable[[], bytes | None] | None = None) -> None:
        """`newest` gives the JPEG at /camera; only an open page asks for it."""
        self._html, self._wanted, self._newest = html.encode(), port, newest
        self._news = threading.Condition()
        self._state = b"{}"
        self._pictures: dict[str, bytes] = {}
        self._version, self._ended = 0, False
        self._server: ThreadingHTTPServer | None = None

    def __enter__(self) -> Self:
        """Listen at the wanted port. Raises UsageError if it is in use."""
        self._server = _listening(self._handler(), self._wanted)
        threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.2}, daemon=True).start()
        return self

    def __exit__(self, *exc: object) -> None:
        with self._news:
            self._ended = True
            self._news.notify_all()
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()

    @property
    def port(self) -> int:
        """The port at which it listens. Raises ValueError before."""
        if self._server is None:
            raise ValueError("the page is not served yet")
        return int(self._server.server_address[1])

    @property
    def address(self) -> str:
        """The address for a browser on this computer."""
        return f"http://{HOST}:{self.port}/"

    def show(self, state: Mapping[str, Any], pictures: Mapping[str, bytes]) -> None:
        """Replace the page's state and its JPEG pictures (by name)."""
        content = json.dumps(state, allow_nan=False).encode()
        with self._news:
            self._state, self._pictures = content, dict(pictures)
            self._version += 1
            self._news.notify_all()

    def _after(self, version: int) -> tuple[int, bytes | None]:
        """The next state after `version`; None after `KEEP_ALIVE_S` without one. Version -1: the page has ended."""
        with self._news:
            is_new = self._news.wait_for(lambda: self._ended or self._version > version, KEEP_ALIVE_S)
            if self._version > version:
                return self._version, self._state
            return (-1, None) if is_new else (version, None)

    def _handler(self) -> Callable[..., BaseHTTPRequestHandler]:
        page = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                """The page, a picture, or the stream of states."""
                if _host(self.headers.get("Host", "")) not in _OURS:  # from another site's page
                    self.send_error(HTTPStatus.FORBIDDEN)
                    return
                path = self.path.partition("?")[0]
                if path == "/":
                    self._whole("text/html; charset=utf-8", page._html)
                elif path == "/state":
                    self._stream()
                elif path == "/camera":
                    self._camera()
                elif (picture := page._pictures.get(path.removeprefix("/picture/"))) is not None:
                    self._whole("image/jpeg", picture)
                else:
                    self.send_error(HTTPStatus.NOT_FOUND)

            def _whole(self, kind: str, content: bytes) -> None:
                self.send_response(HTTPStatus.OK)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(content)))
                self.send_header("Cache-Control", "no-store")
                self.send_header("Content-Security-Policy", _POLICY)
                self.end_headers()
                self.wfile.write(content)

            def _camera(self) -> None:
                """The newest picture, or no content while the camera is busy."""
                jpeg = None if page._newest is None else page._newest()
                if jpeg is not None:
                    self._whole("image/jpeg", jpeg)
                else:
                    self.send_response(HTTPStatus.NO_CONTENT)
                    self.send_header("Cache-Control", "no-store")
                    self.end_headers()

            def _stream(self) -> None:
                self.send_response(HTTPStatus.OK)
                self.send_header("Content-Type", "text/event-stream")
                self.send_header("Cache-Control", "no-store")
                self.send_header("Connection", "close")
                self.end_headers()
                self.close_connection = True
                version = 0
                try:
                    while True:
                        version, state = page._after(version)
                        if version < 0:
                            break
                        self.wfile.write(b": \n\n" if state is None else b"data: " + state + b"\n\n")
                    self.wfile.write(b"event: over\ndata: {}\n\n")
                except OSError:  # the page was closed
                    return

            def log_message(self, format: str, *args: Any) -> None:
                """Logs nothing: the terminal belongs to the session."""

        return Handler


class _Quiet(ThreadingHTTPServer):
    """A connection that fails (a reset, a closed page) ends alone, without a traceback in the operator's terminal."""

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Nothing: the client has disconnected."""


def require_free(port: int) -> None:
    """Raises UsageError if the port is in use."""
    _listening(BaseHTTPRequestHandler, port).server_close()


def _host(stated: str) -> str | None:
    """The host's name in a header; None if the header is malformed."""
    try:
        return urlsplit(f"//{stated}").hostname
    except ValueError:
        return None


def _listening(handler: Callable[..., BaseHTTPRequestHandler], port: int | None) -> ThreadingHTTPServer:
    try:
        server = _Quiet((HOST, PORT if port is None else port), handler)
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise
        if port is not None:
            raise UsageError(f"--view-port {port} is taken: name another, or leave it out") from error
        server = _Quiet((HOST, 0), handler)
    server.daemon_threads = True
    return server
