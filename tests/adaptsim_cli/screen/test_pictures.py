"""Pictures in a terminal: who is taken to show them, and that what is sent decodes to the picture."""

from __future__ import annotations

import base64
import re

import cv2
import numpy as np
import pytest

from adaptsim_cli.screen import pictures


@pytest.mark.parametrize(
    ("environment", "protocol"),
    [
        ({"TERM": "xterm-kitty"}, "kitty"),
        ({"TERM": "xterm-256color", "KITTY_WINDOW_ID": "1"}, "kitty"),
        ({"TERM": "xterm-256color", "TERM_PROGRAM": "WezTerm"}, "kitty"),
        ({"TERM": "xterm-256color"}, "none"),
        ({"TERM": "xterm-kitty", "TMUX": "/tmp/tmux-0/default,1,0"}, "none"),
    ],
)
def test_the_environment_names_the_protocol(environment: dict[str, str], protocol: str) -> None:
    assert pictures.named_protocol(environment) == protocol


@pytest.mark.parametrize(
    ("answer", "sixel"), [("\x1b[?62;4;6c", True), ("\x1b[?64;1c", False), ("\x1b[?4c", False), ("", False)]
)
def test_a_terminal_that_knows_sixel_says_so(answer: str, sixel: bool) -> None:
    assert pictures.answers_sixel(answer) is sixel


def test_kitty_gets_the_whole_picture_in_chunks() -> None:
    png = bytes(cv2.imencode(".png", np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8))[1])
    sent = re.findall(r"\x1b_G([^;]*);([^\x1b]*)\x1b\\", pictures.kitty(png))
    assert len(sent) > 1 and all(len(data) <= 4096 for _, data in sent)
    assert [("m=1" in keys) for keys, _ in sent] == [True] * (len(sent) - 1) + [False]
    assert base64.standard_b64decode("".join(data for _, data in sent)) == png


def decoded(text: str, height: int, width: int) -> np.ndarray:
    """What a terminal paints of sixels, as the manual of the VT340 says."""
    body = re.fullmatch(r"\x1bPq\"1;1;\d+;\d+(.*)\x1b\\", text, re.DOTALL)
    assert body is not None
    palette: dict[int, tuple[int, ...]] = {}
    image, x, top, colour = np.zeros((height, width, 3), int), 0, 0, 0
    for token in re.findall(r"#\d+;2;\d+;\d+;\d+|#\d+|!\d+[?-~]|[?-~]|\$|-", body[1]):
        if token.startswith("#") and ";" in token:
            number, _, *rgb = (int(part) for part in token[1:].split(";"))
            palette[number] = tuple(round(255 * value / 100) for value in rgb)
        elif token.startswith("#"):
            colour = int(token[1:])
        elif token in "$-":
            x, top = 0, top + (6 if token == "-" else 0)
        else:
            count = int(token[1:-1]) if token.startswith("!") else 1
            bits = ord(token[-1]) - 63
            for row in range(6):
                if bits >> row & 1:
                    image[top + row, x : x + count] = palette[colour]
            x += count
    return image


def test_sixels_paint_the_picture() -> None:
    levels = np.array([0, 51, 102, 153, 204, 255], np.uint8)
    image = levels[np.random.default_rng(1).integers(0, 6, (20, 33, 3))]
    image[3:9, 5:25] = (255, 0, 51)  # equal neighbours are counted
    assert np.array_equal(decoded(pictures.sixel(image), 20, 33), image)


def test_a_large_picture_is_made_small() -> None:
    jpeg = bytes(cv2.imencode(".jpg", np.zeros((960, 1280, 3), np.uint8))[1])
    assert '"1;1;480;360' in pictures.drawn(jpeg, "sixel")
    assert pictures.drawn(b"no picture", "sixel") == ""
    assert pictures.drawn(jpeg, "none") == ""
