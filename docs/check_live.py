"""Look at the live page, the report and a comparison in a real browser, while a session runs in the simulated lab.

    python docs/check_live.py                          the pendulum, some seconds
    python docs/check_live.py --task scooping --out pictures

Two sessions run with `--view`; the browser has their page open from beginning to end. Then dashboard, report and
comparison are opened. Every page is laid out 1400 and 420 px wide, and as printed. Exit code 1, with a line for each
problem: the console has an error, a page requests something beyond 127.0.0.1 or does not fit its width, or the stream
does not arrive. Needs Chromium or Chrome.
"""

from __future__ import annotations

import argparse
import base64
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from check_site import BROWSERS, PHONE_PX
from websockets.sync.client import ClientConnection, connect

DESK_PX = 1400
OURS = ("127.0.0.1", "localhost", "")
PATIENCE_S = 900.0
_ANSWER_S = 120.0


class Tab:
    """One tab of a browser, over its debugging port."""

    def __init__(self, line: ClientConnection, pictures: Path) -> None:
        self._line, self._pictures, self._count = line, pictures, 0
        self.problems: list[str] = []
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the debugging protocol. Raises SystemExit where it fails."""
        self._count += 1
        self._line.send(json.dumps({"id": self._count, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._line.recv(timeout=_ANSWER_S))
            if message.get("id") == self._count:
                if "error" in message:
                    raise SystemExit(f"{method}: {message['error']}")
                found: dict[str, Any] = message["result"]
                return found
            self._heard(message)

    def script(self, expression: str) -> Any:
        """The value of an expression in the page."""
        return self.ask("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def open(self, address: str) -> None:
        """Navigate there, and wait until it is laid out."""
        self.ask("Page.navigate", url=address)
        until(lambda: self.script("document.readyState") == "complete", f"{address} was not loaded")

    def look(self, name: str) -> None:
        """Pictures at both widths; a page that has to be scrolled sideways is a problem."""
        for width in (DESK_PX, PHONE_PX):
            self.ask("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
            wide = self.script("document.documentElement.scrollWidth")
            if wide > width:
                self.problems.append(f"{name}: {wide} px wide, the window has {width}")
            shot = self.ask("Page.captureScreenshot", captureBeyondViewport=True, format="png")
            (self._pictures / f"{name}-{width}.png").write_bytes(base64.b64decode(shot["data"]))

    def print(self, name: str) -> None:
        """The page as it is printed on A4, without being scaled down to fit; anything wider than the paper is a
        problem.
        """
        self.ask("Emulation.setDeviceMetricsOverride", width=718, height=1000, deviceScaleFactor=1, mobile=False)
        self.ask("Emulation.setEmulatedMedia", media="print")
        wide = self.script("document.documentElement.scrollWidth")
        if wide > 718:
            self.problems.append(f"{name}: {wide} px wide in print, A4 has 718 between its margins")
        pdf = self.ask("Page.printToPDF", printBackground=True, paperWidth=8.27, paperHeight=11.69)
        (self._pictures / f"{name}.pdf").write_bytes(base64.b64decode(pdf["data"]))
        self.ask("Emulation.setEmulatedMedia", media="")

    def _heard(self, message: dict[str, Any]) -> None:
        method, told = message.get("method"), message.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.problems.append(f"exception: {told['exceptionDetails'].get('text')}")
        elif method == "Log.entryAdded" and told["entry"]["level"] == "error":
            self.problems.append(f"console: {told['entry']['text']} {told['entry'].get('url', '')}")
        elif method == "Runtime.consoleAPICalled" and told["type"] == "error":
            self.problems.append(f"console: {told['args']}")
        elif method == "Network.requestWillBeSent":
            address = urlsplit(told["request"]["url"])
            if address.scheme not in ("data", "file", "blob") and address.hostname not in OURS:
                self.problems.append(f"asks beyond this computer: {told['request']['url'][:200]}")


def until(holds: Any, otherwise: str, patience_s: float = PATIENCE_S) -> None:
    """Raises SystemExit with the sentence `otherwise` if it does not become true."""
    deadline_s = time.monotonic() + patience_s
    while not holds():
        if time.monotonic() > deadline_s:
            raise SystemExit(otherwise)
        time.sleep(0.5)


@contextmanager
def tab(pictures: Path) -> Iterator[Tab]:
    """A tab of a browser of its own."""
    browser = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if browser is None:
        raise SystemExit(f"no browser: install one of {', '.join(BROWSERS)}")
    with tempfile.TemporaryDirectory() as folder:
        flags = ("--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0", "--hide-scrollbars")
        with subprocess.Popen(
            [browser, *flags, f"--user-data-dir={folder}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as process:
            try:
                ready = Path(folder) / "DevToolsActivePort"
                until(lambda: ready.is_file() and len(ready.read_text().splitlines()) == 2, f"{browser} did not start")
                port, way = ready.read_text().splitlines()
                with connect(
                    f"ws://127.0.0.1:{port}{way}", max_size=None, open_timeout=_ANSWER_S, ping_interval=None
                ) as line:
                    line.send(json.dumps({"id": 0, "method": "Target.getTargets"}))
                    targets = json.loads(line.recv(timeout=_ANSWER_S))["result"]["targetInfos"]
                target = next(one["targetId"] for one in targets if one["type"] == "page")
                address = f"ws://127.0.0.1:{port}/devtools/page/{target}"
                with connect(address, max_size=None, open_timeout=_ANSWER_S, ping_interval=None) as line:
                    yield Tab(line, pictures)
            finally:
                process.terminate()


def free_port() -> int:
    """A port at which nobody listens now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def adaptsim(*arguments: str) -> list[str]:
    """The program, as this Python runs it."""
    return [sys.executable, "-c", "from adaptsim_cli.commands.app import main; main()", *arguments]


@contextmanager
def live_session(page: Tab, shown: str, *arguments: str) -> Iterator[None]:
    """A running session, unattended, with its page open; entered once the page's expression `shown` is true."""
    port = free_port()
    command = adaptsim("run-iteration", *arguments, "--yes", "--view-port", str(port))
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        address = next(line.split()[-1] for line in running.stdout if line.startswith("Live page:"))
        page.open(address)
        until(lambda: page.script(f"Boolean({shown})"), "no trial arrived")
        yield
        running.communicate()


def watched(page: Tab, task: str, session: str, more: list[str]) -> None:
    """Run one iteration with its page open, and look at it when everything is shown and after its end."""
    shown = "state.judged && state.rewards && state.rewards.length"
    with live_session(page, shown, "--task", task, "--session", session, *more):
        page.look(f"live-{session}")
    until(lambda: page.script("over") is True, "the page does not say that the command has ended", 60.0)
    if page.script("document.body.innerText.includes('SIMULATED')") is not True:
        page.problems.append("the live page does not say SIMULATED")


def dashboard(page: Tab) -> None:
    """The page of all sessions, served."""
    command = [*adaptsim("dashboard", "--no-browser"), "--port", str(free_port())]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as serving:
        assert serving.stdout is not None
        page.open(serving.stdout.readline().split()[-1])
        until(lambda: page.script("document.querySelectorAll('#chart .dot').length > 0"), "no curve was drawn", 60.0)
        page.look("dashboard")
        page.script(
            "document.querySelector('#search').value = 'udr';"
            "document.querySelector('#search').dispatchEvent(new Event('input', {bubbles: true}))"
        )
        if (
            page.script("[...document.querySelectorAll('#sessions tbody tr')].filter(row => row.offsetHeight).length")
            != 1
        ):
            page.problems.append("dashboard: the search leaves other sessions on a phone")
        page.print("dashboard")
        page.open("about:blank")  # a stream would keep the server busy
        serving.terminate()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="pendulum")
    parser.add_argument("--world", default="ood-1")
    parser.add_argument("--out", type=Path, default=Path("build/live"), help="folder for the pictures")
    parser.add_argument("--once", action="store_true", help="one session alone, and no comparison")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as home, tab(asked.out.absolute()) as page:
        os.environ["ADAPTSIM_HOME"] = home
        sessions = [("adapted", []), *([] if asked.once else [("udr", ["--method", "udr"])])]
        for name, more in sessions:
            watched(page, asked.task, name, ["--world", asked.world, *more])
        root = Path(home) / "data/sessions"
        dashboard(page)
        pages = {"report": root / "adapted/report.html"}
        if not asked.once:
            told = subprocess.run(
                adaptsim("compare", "adapted", "udr", "--json"), check=True, capture_output=True, text=True
            )
            pages["comparison"] = Path(json.loads(told.stdout)["page"])
        for name, path in pages.items():
            page.open(path.as_uri())
            page.look(name)
            page.print(name)
        problems = list(dict.fromkeys(page.problems))
    print("\n".join(problems) or f"no errors, nothing beyond this computer, every page fits; pictures: {asked.out}")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
