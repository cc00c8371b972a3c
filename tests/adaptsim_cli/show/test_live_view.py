"""The live page: what it shows when, whom it answers, and that it stays on this computer."""

from __future__ import annotations

import re
import socket
import struct
from collections.abc import Iterator
from functools import partial
from importlib import resources
from typing import Any

import cv2
import numpy as np
import pytest
from real_lab import quiet, said
from served_pages import Events, get
from toy_rig import PARAMETERS, ToyLab
from toy_session import ScriptedOperator, attended

from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.release import Release
from adaptsim_cli.session.flow import RunningSession, run_iteration
from adaptsim_cli.session.live_trial import PlannedTrial
from adaptsim_cli.session.operator import Choices, Review
from adaptsim_cli.session.records import MotionRecord, TrialRecord
from adaptsim_cli.show import live, live_state
from adaptsim_cli.show.dashboard import Dashboard
from adaptsim_cli.show.live import LiveView, live_view
from adaptsim_cli.show.server import LocalServer, Page
from sim.adaptation.posterior import Posterior
from sim.types import Dimension, Space

HTML = (resources.files("adaptsim_cli.show") / "live.html").read_text()


@pytest.fixture
def page() -> Iterator[Page]:
    with Page("<p>hello</p>") as shown:
        yield shown


@pytest.fixture
def server(page: Page) -> Iterator[LocalServer]:
    with LocalServer(Dashboard(None, {"s": page})) as served:
        yield served


def test_it_listens_on_this_computer_alone(server):
    assert server.address == f"http://127.0.0.1:{server.port}/"
    with pytest.raises(OSError):
        socket.create_connection(("127.0.0.2", server.port), timeout=2).close()


@pytest.mark.parametrize(
    ("host", "status"), [("127.0.0.1:9", 200), ("localhost:8765", 200), ("evil.example", 403), ("evil.example:80", 403)]
)
def test_another_sites_page_reads_nothing(server, host, status):
    assert get(server, "/live/s/", host)[0] == status


def test_resets_and_malformed_hosts_leave_the_terminal_alone(server, capfd):
    for sent in (b"GET / HTTP/1.1\r\nHost: [\r\n\r\n", b"GET //[ HTTP/1.1\r\nHost: localhost\r\n\r\n", b"GET"):
        with socket.create_connection(("127.0.0.1", server.port), timeout=20) as one:
            one.sendall(sent)
            if sent.endswith(b"\n"):
                one.recv(64)
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # closes by a reset
    assert get(server, "/live/s/", "[")[0] == 403
    assert get(server, "/live/s/")[0] == 200
    assert capfd.readouterr().err == ""


def test_the_page_may_load_nothing_from_elsewhere(server):
    _, headers, _ = get(server, "/live/s/")
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert not re.search(r"(src|href)=\"(?!data:|\$\{)", HTML), "what it shows comes from its own address"
    assert "http" not in re.sub(r"<!doctype html>", "", HTML)


def test_every_state_arrives_pictures_by_name_and_the_end(page, server):
    page.show({"a": 1}, {"1.jpg": b"\xff\xd8one"})
    events = Events(server)
    assert events.next() == {"a": 1}
    page.show({"a": 2}, {"2.jpg": b"\xff\xd8two"})
    assert events.next() == {"a": 2}
    assert get(server, "/live/s/picture/2.jpg")[2] == b"\xff\xd8two"
    assert get(server, "/live/s/picture/1.jpg")[0] == 404
    assert get(server, "/../secrets")[0] == 404
    page.__exit__(None, None, None)
    assert events.next() is None, "its end is told"
    events.close()


def test_the_cameras_newest_picture_is_asked_for_by_the_page_alone(server):
    assert get(server, "/live/s/camera")[0] == 204, "a page without a camera"
    asked: list[int] = []

    def newest() -> np.ndarray | None:
        asked.append(len(asked))
        return None if len(asked) == 1 else np.full((720, 1280, 3), 90, np.uint8)

    pages = {"s": Page("", partial(live.newest_jpeg, newest))}
    with LocalServer(Dashboard(None, pages)) as watched:
        assert not asked
        assert get(watched, "/live/s/camera")[0] == 204, "the camera is busy"
        status, head, jpeg = get(watched, "/live/s/camera?1")
    assert (status, head["Content-Type"]) == (200, "image/jpeg")
    assert cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR).shape == (540, live.WIDTH_PX, 3)


def test_a_port_that_is_taken_is_an_error_only_where_it_was_asked_for(server):
    with pytest.raises(UsageError, match=f"port {server.port} is taken"), LocalServer(Dashboard(None), server.port):
        pass
    with LocalServer(Dashboard(None)) as first, LocalServer(Dashboard(None)) as second:
        assert first.port != second.port


class Looking(ScriptedOperator):
    """Keeps what the page shows at the moment of each question."""

    def __init__(self, view: LiveView, reviews: list[Review]) -> None:
        super().__init__(reviews)
        self._view = view
        self.approvals: list[dict[str, Any]] = []
        self.judgements: list[tuple[dict[str, Any], dict[str, bytes]]] = []

    def approve(self, trial: MotionRecord, planned: PlannedTrial, real: bool, release: Release) -> None:
        self.approvals.append(dict(self._view._state))

    def review(self, tracked: TrialRecord, choices: Choices) -> Review:
        self.judgements.append((dict(self._view._state), dict(self._view._pictures)))
        return super().review(tracked, choices)


def test_everything_is_on_the_page_before_it_is_asked_about(tmp_path):
    screen = quiet()
    session = attended(tmp_path, ScriptedOperator(), ToyLab(0))
    with live_view(screen, session.parts, "toy-wd", "session toy-wd", "fake", None, 2) as view:
        operator = Looking(view, [Review(rejected="slip")])
        watched = RunningSession(session.store, session.parts, operator, screen, view)
        run_iteration(watched)
        last = dict(view._state)
    first = operator.approvals[0]
    assert first["head"]["simulated"] is True
    assert first["trial"]["number"] == 1 and first["judged"] is None
    assert first["picture"]["width"] == 64
    arm = np.array(first["motion"]["arm_m"])
    assert arm.shape == (len(first["motion"]["t_s"]), 10, 3)
    shown, pictures = operator.judgements[0]
    assert shown["judged"]["outcome"] == "on blade"
    assert pictures[shown["judged"]["film"]["url"].removeprefix("picture/")].startswith(b"\xff\xd8")
    assert len(shown["judged"]["track_px"]) == 3
    assert operator.approvals[1]["trial"]["attempt"] == 2
    assert [r["number"] for r in last["rewards"]] == [1, 2, 3, 4]
    assert [len(p["steps"]) for p in last["parameters"]] == [2, 2]
    assert last["verdict"].startswith("Converged")


def test_the_terminal_says_where_the_page_is_and_how_to_reach_it(tmp_path):
    screen = quiet()
    session = attended(tmp_path, ScriptedOperator(), ToyLab(0))
    with live_view(screen, session.parts, "toy-wd", "session toy-wd", "fake", None, 2) as view:
        with screen.busy("Finding the piece"):
            assert view._state["now"]["doing"] == "Finding the piece"
        for move in range(3):
            with screen.busy("The robot moves", "moving"):
                assert view._state["now"]["move"] == move, "the page plays this part of the plan"
        assert view._state["now"]["doing"] == ""
    port = re.search(r"Live page: http://127.0.0.1:(\d+)/live/toy-wd/", said(screen))
    assert f"ssh -L {port[1]}:127.0.0.1:{port[1]} " in said(screen)


def test_the_posterior_of_a_parameter_adds_up_over_its_range():
    rng = np.random.default_rng(0)
    samples = PARAMETERS.sample(rng, 500)
    weights = np.where(samples[:, 0] > 0.35, 1.0, 0.0)
    told = live_state._marginals(PARAMETERS, Posterior(PARAMETERS, samples, weights / weights.sum()))
    assert np.allclose(np.sum(told, axis=1), 1.0, atol=1e-3)
    assert np.sum(told[0][: int(0.75 * live_state.BINS)]) == 0.0, "nothing below 0.35 of the range 0.2 to 0.4"


def test_the_values_of_a_parameter_share_the_unit_of_its_range():
    stiffness = Dimension("e", "Pa", 1e4, 5e5, "log")
    assert live_state._values(stiffness, np.array([7.57e4, 1.97e4])) == {
        "unit": "kPa",
        "low": "10",
        "high": "500",
        "now": ["75.7", "19.7"],
    }


def test_a_category_is_shown_by_its_words_and_not_by_numbers():
    shape = Dimension("g", "", 0, 1, "integer", meaning="0 ellipsoid, 1 cylinder")
    ends = {"unit": "", "low": "ellipsoid", "high": "cylinder"}
    assert live_state._values(shape, np.array([0.8, 0.0])) == {**ends, "now": ["cylinder", "ellipsoid"]}
    assert live_state.quantities(Space((shape,)), {"g": 1.0})[0]["value"] == "cylinder"
