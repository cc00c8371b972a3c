"""Small pictures in a terminal that knows kitty's graphics protocol ("Terminal graphics protocol" of kitty). Pure."""

from __future__ import annotations

import base64
from collections.abc import Mapping

import numpy as np

WIDE_PX = 480
"""Largest width of a picture: half of a screen of 100 columns."""
_KITTY = ("kitty", "ghostty", "wezterm")
_CHUNK = 4096


def knows_kitty(environment: Mapping[str, str]) -> bool:
    """Whether the terminal shows pictures, by environment variables; tmux and screen hide the outer terminal."""
    if environment.get("TMUX") or environment.get("STY"):
        return False
    said = f"{environment.get('TERM', '')} {environment.get('TERM_PROGRAM', '')}".lower()
    return bool(environment.get("KITTY_WINDOW_ID")) or any(name in said for name in _KITTY)


def drawn(jpeg: bytes) -> str:
    """The escape sequences that show a reduced JPEG; "" if it is no picture."""
    import cv2

    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        return ""
    scale = min(1.0, WIDE_PX / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return kitty(cv2.imencode(".png", small)[1].tobytes())


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
