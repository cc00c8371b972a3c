"""Pictures in a terminal: who is taken to show them, and that what is sent decodes to the picture."""

from __future__ import annotations

import base64
import re

import cv2
import numpy as np
import pytest

from adaptsim_cli.screen import views


@pytest.mark.parametrize(
    ("environment", "shows"),
    [
        ({"TERM": "xterm-kitty"}, True),
        ({"TERM": "xterm-256color", "KITTY_WINDOW_ID": "1"}, True),
        ({"TERM": "xterm-256color", "TERM_PROGRAM": "WezTerm"}, True),
        ({"TERM": "xterm-256color"}, False),
        ({"TERM": "xterm-kitty", "TMUX": "/tmp/tmux-0/default,1,0"}, False),
    ],
)
def test_the_environment_names_the_terminal(environment, shows):
    assert views.knows_kitty(environment) is shows


def test_kitty_gets_the_whole_picture_in_chunks():
    png = bytes(cv2.imencode(".png", np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8))[1])
    sent = re.findall(r"\x1b_G([^;]*);([^\x1b]*)\x1b\\", views.kitty(png))
    assert len(sent) > 1 and all(len(data) <= 4096 for _, data in sent)
    assert [("m=1" in keys) for keys, _ in sent] == [True] * (len(sent) - 1) + [False]
    assert base64.standard_b64decode("".join(data for _, data in sent)) == png


def test_a_large_picture_is_made_small():
    jpeg = bytes(cv2.imencode(".jpg", np.zeros((960, 1280, 3), np.uint8))[1])
    sent = re.findall(r"\x1b_G[^;]*;([^\x1b]*)\x1b", views.drawn(jpeg))
    png = np.frombuffer(base64.standard_b64decode("".join(sent)), np.uint8)
    small = cv2.imdecode(png, cv2.IMREAD_COLOR)
    assert small is not None and small.shape == (360, 480, 3)
    assert views.drawn(b"no picture") == ""
