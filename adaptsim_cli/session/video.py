"""A completed trial as a video: the camera's pictures with the tracked centre, its path, the time and the outcome."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from adaptsim_cli.errors import SessionError
from adaptsim_cli.session.film import draw_way, way_px, write
from adaptsim_cli.session.target import Image
from adaptsim_cli.session.whole import WholeTrial

SUFFIX = ".webm"
_HEIGHT_PX, _FPS = 540, 30.0
_RING_PX = 9


def encode(trial: WholeTrial) -> bytes:
    """The whole video in memory, at the speed of the camera. Raises SessionError without frames or an encoder."""
    if not trial.stored.frames:
        raise SessionError(f"{trial.file} holds no frames of the motion")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"video{SUFFIX}"
        first = trial.stored.frames[0].colour
        size = (round(first.shape[1] * _HEIGHT_PX / first.shape[0]) // 2 * 2, _HEIGHT_PX)
        with _silent():  # OpenCV warns of the only tag that it takes for VP8
            writer = cv2.VideoWriter(os.fspath(file), cv2.VideoWriter.fourcc(*"VP80"), _fps(trial), size)
        if not writer.isOpened():
            raise SessionError("OpenCV has no VP8 encoder here, so no video can be written: try --rerun")
        try:
            for picture in _pictures(trial, size):
                writer.write(picture)
        finally:
            writer.release()
        return file.read_bytes()


def _pictures(trial: WholeTrial, size: tuple[int, int]) -> list[Image]:
    found, stored, track = list[Image](), trial.stored, trial.record.track.track()
    scale = size[1] / stored.frames[0].colour.shape[0]
    for frame in stored.frames:
        picture = np.array(cv2.resize(frame.colour, size, interpolation=cv2.INTER_AREA), np.uint8)
        since_s = frame.t_s - trial.start_s
        if track.t_s[0] <= since_s:
            draw_way(picture, scale * way_px(stored.model, stored.X_BC, track, since_s), _RING_PX)
        text = f"{since_s:5.2f} s"
        if since_s >= track.t_s[-1]:
            text += f"   {trial.record.outcome_words}, reward {trial.record.reward:.2f}"
        write(picture, text, (14, size[1] - 16), 0.7)
        found.append(np.ascontiguousarray(picture[..., ::-1]))
    return found


@contextmanager
def _silent() -> Iterator[None]:
    """Discard what libraries write to stderr."""
    kept = os.dup(2)
    with Path(os.devnull).open("wb") as nothing:
        os.dup2(nothing.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _fps(trial: WholeTrial) -> float:
    times_s = np.array([frame.t_s for frame in trial.stored.frames])
    return float(1.0 / np.median(np.diff(times_s))) if len(times_s) > 1 else _FPS
