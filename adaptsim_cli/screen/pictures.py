"""Small pictures in a terminal, by kitty's graphics protocol or sixel. Pure, except `protocol_of`.

Sources: "Terminal graphics protocol" of kitty; DEC VT340 manual, chapter 14 (sixel), as in xterm.
"""

from __future__ import annotations

import base64
import os
import re
import select
import sys
import time
from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Protocol = Literal["kitty", "sixel", "none"]
Image = NDArray[np.uint8]

WIDE_PX = 480
"""Largest width of a picture: half of a screen of 100 columns."""
_KITTY = ("kitty", "ghostty", "wezterm")
_CHUNK = 4096
_ANSWER_S = 0.3
_LEVELS = 6
"""Levels of red, green and blue in sixel's palette."""
_BAND = 6
"""Rows of pixels in one row of sixels."""


def named_protocol(environment: Mapping[str, str]) -> Protocol:
    """The protocol by environment variables; inside tmux and screen they do not describe the outer terminal."""
    if environment.get("TMUX") or environment.get("STY"):
        return "none"
    said = f"{environment.get('TERM', '')} {environment.get('TERM_PROGRAM', '')}".lower()
    return "kitty" if environment.get("KITTY_WINDOW_ID") or any(name in said for name in _KITTY) else "none"


def protocol_of(environment: Mapping[str, str]) -> Protocol:
    """The protocol by the environment, else by the terminal's answer: its attributes contain a 4 if it knows sixel."""
    if (named := named_protocol(environment)) != "none":
        return named
    if not (sys.stdin.isatty() and sys.stdout.isatty()) or environment.get("TERM", "dumb") == "dumb":
        return "none"
    return "sixel" if answers_sixel(_attributes()) else "none"


def answers_sixel(attributes: str) -> bool:
    """Whether the answer to `ESC [ c` names sixel graphics."""
    found = re.search(r"\x1b\[\?([\d;]+)c", attributes)
    return found is not None and "4" in found[1].split(";")[1:]


def _attributes() -> str:
    from adaptsim_cli.screen.keyboard import key_by_key

    fd, said, until_s = sys.stdin.fileno(), b"", time.monotonic() + _ANSWER_S
    with key_by_key(fd):
        os.write(sys.stdout.fileno(), b"\x1b[c")
        while not said.endswith(b"c") and (left_s := until_s - time.monotonic()) > 0.0:
            if select.select([fd], [], [], left_s)[0]:
                said += os.read(fd, 1)
    return said.decode(errors="replace")


def drawn(jpeg: bytes, protocol: Protocol) -> str:
    """The escape sequences that show a reduced JPEG; "" if the terminal cannot show pictures."""
    import cv2

    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None or protocol == "none":
        return ""
    scale = min(1.0, WIDE_PX / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    if protocol == "kitty":
        return kitty(cv2.imencode(".png", small)[1].tobytes())
    return sixel(np.asarray(small[..., ::-1], np.uint8))


def kitty(png: bytes) -> str:
    """A PNG as kitty's escape sequences."""
    data = base64.standard_b64encode(png).decode()
    chunks = [data[i : i + _CHUNK] for i in range(0, len(data), _CHUNK)]
    parts = []
    for index, chunk in enumerate(chunks):
        more = int(index < len(chunks) - 1)
        head = f"a=T,f=100,m={more}" if index == 0 else f"m={more}"
        parts.append(f"\x1b_G{head};{chunk}\x1b\\")
    return "".join(parts)


def sixel(image: Image) -> str:
    """(H, W, 3) RGB as sixels, in a palette of 6 x 6 x 6 colours."""
    height, width = image.shape[:2]
    level = np.rint(image.astype(float) / 255.0 * (_LEVELS - 1)).astype(int)
    colour = (level[..., 0] * _LEVELS + level[..., 1]) * _LEVELS + level[..., 2]
    palette = "".join(
        f"#{c};2;{_percent(c // _LEVELS**2)};{_percent(c // _LEVELS % _LEVELS)};{_percent(c % _LEVELS)}"
        for c in np.unique(colour)
    )
    rows = [_band(colour[top : top + _BAND]) for top in range(0, height, _BAND)]
    return f'\x1bPq"1;1;{width};{height}{palette}{"-".join(rows)}\x1b\\'


def _percent(level: int) -> int:
    return round(100 * level / (_LEVELS - 1))


def _band(colour: NDArray[np.int_]) -> str:
    """Up to six rows (R, W) of palette numbers as sixels: one pass from the left per colour."""
    weights = (1 << np.arange(len(colour)))[:, None]
    parts = []
    for c in np.unique(colour):
        bits = ((colour == c) * weights).sum(axis=0)
        parts.append(f"#{c}" + _runs(bits))
    return "$".join(parts)


def _runs(bits: NDArray[np.int_]) -> str:
    """Sixels (W,) in run-length encoding."""
    starts = np.flatnonzero(np.diff(bits, prepend=-1))
    lengths = np.diff(starts, append=len(bits))
    return "".join(
        f"!{n}{chr(63 + bits[s])}" if n > 3 else chr(63 + bits[s]) * n for s, n in zip(starts, lengths, strict=True)
    )
