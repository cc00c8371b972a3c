"""All random numbers of one attempt at one trial, from (seed, trial, attempt) only.

Every draw has its own stream, so no result depends on earlier draws, on the number of device calls, or on a restart of
the process.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.types import Array

PLACING_STD_M = 0.002
"""Accuracy of a person who places a piece on a mark, m."""

REPEATABILITY_RAD = 1e-4
"""Joint error that is constant during a trial. It is about 0.1 mm at the tool, which is the maker's repeatability."""

_TRIAL, _FRAME, _SNAPSHOT, _CAMERA, _CALIBRATION, _JOINTS, _VIEW = range(7)
_MOVED, _GUIDED = 8, 9  # a session of an earlier version had a stream 7


@dataclass(frozen=True, eq=False)
class RngStreams:
    """The draws of one attempt."""

    key: tuple[int, int, int]  # seed, trial, attempt
    placing_m: Array  # (2,)
    joint_offset_rad: Array  # (7,)
    frame_phase: float  # of the first frame after the object is placed, in frame periods: [0, 1)
    stop_fraction: float  # share of the path at which a fault stops the arm

    @classmethod
    def draw(cls, seed: int, trial: int, attempt: int) -> RngStreams:
        """All draws of an attempt."""
        key = (seed, trial, attempt)
        rng = _stream(seed, _TRIAL, trial, attempt)
        return cls(
            key=key,
            placing_m=PLACING_STD_M * np.clip(rng.standard_normal(2), -2.5, 2.5),
            joint_offset_rad=REPEATABILITY_RAD * rng.standard_normal(7),
            frame_phase=float(rng.uniform()),
            stop_fraction=float(rng.uniform(0.3, 0.6)),
        )

    def frame_stream(self, index: int) -> np.random.Generator:
        """The stream of frame `index`, counted from the placing of the object."""
        seed, trial, attempt = self.key
        return _stream(seed, _FRAME, trial, attempt, index)

    def snapshot_stream(self, t_s: float) -> np.random.Generator:
        """The stream of a picture at time `t_s`: the same time gives the same picture."""
        seed, trial, attempt = self.key
        return _stream(seed, _SNAPSHOT, trial, attempt, round(1e6 * t_s))


def camera_stream(seed: int) -> np.random.Generator:
    """The stream for the individual properties of a lab's camera."""
    return _stream(seed, _CAMERA)


def moved_stream(seed: int) -> np.random.Generator:
    """The stream for the place to which somebody moved the camera."""
    return _stream(seed, _MOVED)


def calibration_stream(seed: int) -> np.random.Generator:
    """The stream for the error of the nominal calibration."""
    return _stream(seed, _CALIBRATION)


def joint_zeros(seed: int, joint_offset_mrad: float) -> Array:
    """(7,) true minus reported joint positions: constant for one lab."""
    return np.asarray(1e-3 * joint_offset_mrad * _stream(seed, _JOINTS).standard_normal(7))


def view_stream(seed: int, rest: int, picture: int) -> np.random.Generator:
    """The stream of one picture of the calibration board (from 1) at one rest of the arm; 0 is the rest itself."""
    return _stream(seed, _VIEW, rest, picture)


def guided_stream(seed: int, number: int) -> np.random.Generator:
    """The stream of one set-down by hand (from 1)."""
    return _stream(seed, _GUIDED, number)


def _stream(seed: int, *key: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
