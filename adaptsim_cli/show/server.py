"""The server of all pages, only on this computer: contents and server-sent events go out, nothing comes in.

A running command has a `Page` of its own; the dashboard (`dashboard.py`) is the site around it.
"""

from __future__ import annotations

import errno
import json
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self
from urllib.parse import unquote, urlsplit

from adaptsim_cli.errors import UsageError

HTML, JPEG = "text/html; charset=utf-8", "image/jpeg"
HOST = "127.0.0.1"
PORT = 8765
KEEP_ALIVE_S = 5.0
"""Time without news after which a comment is sent, to notice a closed page."""

_POLICY = (
    "default-src 'none'; img-src 'self' data:; connect-src 'self'; "
    "style-src 'unsafe-inline'; script-src 'unsafe-inline'"
)
_OURS = frozenset({"127.0.0.1", "localhost"})


@dataclass(frozen=True)
class Content:
    """What a browser gets: bytes of a kind, or no content."""

    kind: str
    body: bytes | None


Answer = Content | Iterator[bytes]
"""Content, or a stream of server-sent events that goes on until the page is closed."""

Site = Callable[[str], Answer | None]
"""The path of a request, without its query -> the answer; None if there is nothing at this path."""

OVER = b"event: over\ndata: {}\n\n"
"""The last event of a stream."""
KEEP_ALIVE = b": \n\n"


def event(state: bytes) -> bytes:
    """One server-sent event with a state as JSON."""
    return b"data: " + state + b"\n\n"


class LocalServer:
    """Serves a site only on this computer. It only reads: every request except GET is refused."""

    def __init__(self, site: Site, port: int | None = None) -> None:
        self._site, self._wanted = site, port
        self._server: ThreadingHTTPServer | None = None

    def __enter__(self) -> Self:
        """Listen at the wanted port. Raises UsageError if it is in use."""
        self._server = _listening(_handler(self._site), self._wanted)
        threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.2}, daemon=True).start()
        return self

    def __exit__(self, *exc: object) -> None:
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()

    @property
    def port(self) -> int:
        """The port at which it listens. Raises ValueError before."""
        if self._server is None:
            raise ValueError("nothing is served yet")
        return int(self._server.server_address[1])

    @property
    def address(self) -> str:
        """The address for a browser on this computer."""
        return f"http://{HOST}:{self.port}/"

    @property
    def tunnel(self) -> str:
        """The command that makes the address reachable from another computer."""
        import getpass
        import socket

        return f"ssh -L {self.port}:{HOST}:{self.port} {getpass.getuser()}@{socket.gethostname()}"


class Page:
    """The page of one running command; open pages show every `show` at once."""

    def __init__(self, html: str, newest: Callable[[], bytes | None] | None = None) -> None:
        """`newest` gives the JPEG at `camera`; only an open page asks for it."""
        self._html, self._newest = html.encode(), newest
        self._news = threading.Condition()
        self._state = b"{}"
        self._pictures: dict[str, bytes] = {}
        self._version, self._ended = 0, False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        """Tell every open page that the command has ended."""
        with self._news:
            self._ended = True
            self._news.notify_all()

    def show(self, state: Mapping[str, Any], pictures: Mapping[str, bytes]) -> None:
        """Replace the page's state and its JPEG pictures (by name)."""
        content = json.dumps(state, allow_nan=False).encode()
        with self._news:
            self._state, self._pictures = content, dict(pictures)
            self._version += 1
            self._news.notify_all()

    def get(self, path: str) -> Answer | None:
        """The page at "", its stream of states, the camera's newest picture (none while it is busy), or a picture."""
        if path == "":
            return Content(HTML, self._html)
        if path == "state":
            return self._states()
        if path == "camera":
            return Content(JPEG, None if self._newest is None else self._newest())
        picture = self._pictures.get(path.removeprefix("picture/"))
        return None if picture is None else Content(JPEG, picture)

    def _states(self) -> Iterator[bytes]:
        version = 0
        while version >= 0:
            version, state = self._after(version)
            yield OVER if version < 0 else KEEP_ALIVE if state is None else event(state)

    def _after(self, version: int) -> tuple[int, bytes | None]:
        """The next state after `version`, or None if none comes within `KEEP_ALIVE_S`. Version -1 means that the page
        has ended.
        """
        with self._news:
            is_new = self._news.wait_for(lambda: self._ended or self._version > version, KEEP_ALIVE_S)
            if self._version > version:
                return self._version, self._state
            return (-1, None) if is_new else (version, None)


def _handler(site: Site) -> Callable[..., BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            """The answer of the site."""
            if _host(self.headers.get("Host", "")) not in _OURS:  # from another site's page
                self.send_error(HTTPStatus.FORBIDDEN)
                return
            answer = site(unquote(self.path.partition("?")[0]))
            if answer is None:
                self.send_error(HTTPStatus.NOT_FOUND)
            elif isinstance(answer, Content):
                self._whole(answer)
            else:
                self._stream(answer)

        def _whole(self, content: Content) -> None:
            self.send_response(HTTPStatus.NO_CONTENT if content.body is None else HTTPStatus.OK)
            if content.body is not None:
                self.send_header("Content-Type", content.kind)
                self.send_header("Content-Length", str(len(content.body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("Content-Security-Policy", _POLICY)
            self.end_headers()
            self.wfile.write(content.body or b"")

        def _stream(self, events: Iterator[bytes]) -> None:
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/event-stream")
            self.send_header("Cache-Control", "no-store")
            self.send_header("Connection", "close")
            self.end_headers()
            self.close_connection = True
            try:
                for sent in events:
                    self.wfile.write(sent)
            except OSError:  # the page was closed
                return

        def log_message(self, format: str, *args: Any) -> None:
            """Logs nothing, because the terminal belongs to the session."""

    return Handler


class _Quiet(ThreadingHTTPServer):
    """A connection that fails (a reset, a closed page) ends alone, without a traceback in the operator's terminal."""

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Does nothing, because the client has disconnected."""


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
            raise UsageError(f"port {port} is taken: name another, or leave the option out") from error
        server = _Quiet((HOST, 0), handler)
    server.daemon_threads = True
    return server
