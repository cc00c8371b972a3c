"""A completed trial as a video: the camera's pictures with the tracked centre, its path, the time and the outcome."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import cv2
import numpy as np

from adaptsim_cli.errors import SessionError
from adaptsim_cli.session.whole import WholeTrial, centre_px

SUFFIX = ".webm"
_HEIGHT_PX, _FPS = 540, 30.0
_RING, _DARK = (40, 190, 255), (20, 20, 20)  # BGR


def encode(trial: WholeTrial) -> bytes:
    """The whole video in memory, at the speed of the camera. Raises SessionError without frames or an encoder."""
    if not trial.stored.frames:
        raise SessionError(f"{trial.file} holds no frames of the motion")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"video{SUFFIX}"
        first = trial.stored.frames[0].colour
        size = (round(first.shape[1] * _HEIGHT_PX / first.shape[0]) // 2 * 2, _HEIGHT_PX)
        writer = cv2.VideoWriter(os.fspath(file), cv2.VideoWriter.fourcc(*"VP80"), _fps(trial), size)
        if not writer.isOpened():
            raise SessionError("OpenCV has no VP8 encoder here, so no video can be written: try --rerun")
        try:
            for picture in _pictures(trial, size):
                writer.write(picture)
        finally:
            writer.release()
        return file.read_bytes()


def _pictures(trial: WholeTrial, size: tuple[int, int]) -> list[np.ndarray[tuple[int, ...], np.dtype[np.uint8]]]:
    found, way = [], list[tuple[int, int]]()
    scale = size[1] / trial.stored.frames[0].colour.shape[0]
    end_s = trial.start_s + trial.record.track.t_s[-1]
    for frame in trial.stored.frames:
        small = cv2.resize(frame.colour[..., ::-1], size, interpolation=cv2.INTER_AREA)
        picture = np.ascontiguousarray(small, np.uint8)
        centre = centre_px(trial, frame.t_s)
        if centre is not None:
            way.append((round(centre[0] * scale), round(centre[1] * scale)))
        if way:
            cv2.polylines(picture, [np.array(way, np.int32).reshape(-1, 1, 2)], False, _RING, 1, cv2.LINE_AA)
            for colour, width in ((_DARK, 3), (_RING, 1)):
                cv2.circle(picture, way[-1], 9, colour, width, cv2.LINE_AA)
        text = f"{frame.t_s - trial.start_s:5.2f} s"
        if frame.t_s >= end_s:
            text += f"   {trial.record.outcome_words}, reward {trial.record.reward:.2f}"
        for colour, width in ((_DARK, 4), ((255, 255, 255), 1)):
            cv2.putText(picture, text, (14, size[1] - 16), cv2.FONT_HERSHEY_SIMPLEX, 0.7, colour, width, cv2.LINE_AA)
        found.append(picture)
    return found


def _fps(trial: WholeTrial) -> float:
    times_s = np.array([frame.t_s for frame in trial.stored.frames])
    return float(1.0 / np.median(np.diff(times_s))) if len(times_s) > 1 else _FPS
