"""Recordings as a Kinect writes them, in small."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

CALIBRATION = Path(__file__).parents[1] / "perception" / "data" / "kinect_calibration.json"
SMALL = (64, 48)  # pixels, width and height


def record(
    path: Path,
    colour_s: list[float],
    depth_s: list[float],
    titles: tuple[str, str] = ("COLOR", "DEPTH"),
    infrared_s: list[float] | None = None,
    colour_mode: str = "MJPG_720P",
) -> None:
    """A file laid out like those of k4arecorder: frame i has the grey value 10 i, and 1000 + i in its first column."""
    times_s = [colour_s, depth_s] if infrared_s is None else [colour_s, depth_s, infrared_s]
    with av.open(str(path), "w", format="matroska") as container:
        container.metadata["K4A_START_OFFSET_NS"] = "2000000000"
        container.add_attachment("calibration.json", "application/octet-stream", CALIBRATION.read_bytes())
        tracks: list[Any] = []
        for title, codec, layout, key, mode in (
            (titles[0], "mjpeg", "yuvj422p", "K4A_COLOR_MODE", colour_mode),
            (titles[1], "ffv1", "gray16le", "K4A_DEPTH_MODE", "NFOV_UNBINNED"),
            ("IR", "ffv1", "gray16le", "K4A_IR_MODE", "ACTIVE"),
        )[: len(times_s)]:
            track: Any = container.add_stream(codec, rate=30)
            track.width, track.height, track.pix_fmt = *SMALL, layout
            track.metadata["title"], track.metadata[key] = title, mode
            tracks.append(track)
        images = [(t, which, i) for which, track_s in enumerate(times_s) for i, t in enumerate(track_s)]
        for t_s, which, i in sorted(images):
            pixels = np.full((*SMALL[::-1], 3), 10 * i, np.uint8)
            depth = np.full(SMALL[::-1], 500, np.uint16)
            depth[:, 0] = 1000 + i
            frame = (
                av.VideoFrame.from_ndarray(pixels, format="rgb24")
                if which == 0
                else av.VideoFrame.from_ndarray(depth, format="gray16le")
            )
            frame.pts, frame.time_base = round(30 * t_s), Fraction(1, 30)
            container.mux(tracks[which].encode(frame))
        for written in tracks:
            container.mux(written.encode())
