"""`Watcher` that shows small pictures in the terminal, if the terminal can."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.operator import Judged, Proposal
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.watching import Seen, Sight, Telling
from hw.bounded import decode_image
from perception.types import ObjectTrack


class InTerminal:
    """Shows the camera's picture before the motion, and the key frames in a row before the review."""

    def __init__(self, screen: Screen) -> None:
        self._screen = screen

    def proposed(self, made: Proposal, sight: Sight | None) -> None:
        """See `Watcher`."""
        if sight is not None:
            self._screen.picture(sight.picture)

    def tracked(self, judged: Judged, track: ObjectTrack, seen: Seen) -> None:
        """See `Watcher`."""
        if seen.moments:
            self._screen.picture(strip([seen.files[moment.file] for moment in seen.moments]))

    def changed(self, store: SessionStore, posterior: Telling) -> None:
        """See `Watcher`; does nothing, because the numbers are shown as text."""

    def reported(self, path: Path) -> None:
        """See `Watcher`; does nothing, because the path is shown as text."""


def strip(jpegs: list[bytes]) -> bytes:
    """One JPEG with the pictures side by side, at the same height."""
    images = [decode_image(jpeg, cv2.IMREAD_COLOR) for jpeg in jpegs]
    return bytes(cv2.imencode(".jpg", np.hstack(images))[1].tobytes())
