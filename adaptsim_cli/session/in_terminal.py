"""`Watcher` that shows small pictures in the terminal, if the terminal can."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.operator import Proposal
from adaptsim_cli.session.records import TrialRecord
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import MotionPreview, TrackedTrial
from adaptsim_cli.session.watching import PosteriorSource
from hw.bounded import decode_image


class InTerminal:
    """Shows the camera's picture before the motion, and the key frames in a row before the review."""

    def __init__(self, screen: Screen) -> None:
        self._screen = screen

    def proposed(self, made: Proposal, preview: MotionPreview | None) -> None:
        """See `Watcher`."""
        if preview is not None:
            self._screen.picture(preview.picture)

    def tracked(self, record: TrialRecord, seen: TrackedTrial) -> None:
        """See `Watcher`."""
        if seen.moments:
            self._screen.picture(strip([seen.files[moment.file] for moment in seen.moments]))

    def changed(self, store: SessionStore, posterior: PosteriorSource) -> None:
        """See `Watcher`; does nothing, because the numbers are shown as text."""

    def reported(self, path: Path) -> None:
        """See `Watcher`; does nothing, because the path is shown as text."""


def strip(jpegs: list[bytes]) -> bytes:
    """One JPEG with the pictures side by side, at the same height."""
    images = [decode_image(jpeg, cv2.IMREAD_COLOR) for jpeg in jpegs]
    return bytes(cv2.imencode(".jpg", np.hstack(images))[1].tobytes())
