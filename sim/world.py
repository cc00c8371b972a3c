"""Worlds of the simulated lab: hidden parameters, unmodelled effects, sensing and faults, as TOML."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hw.types import Array


@dataclass(frozen=True)
class Sensing:
    """How the lab's camera deviates from a perfect one."""

    depth_noise_scale: float = 1.0  # 1 = the Azure Kinect model
    extrinsic_error_mm: float = 1.0
    extrinsic_error_deg: float = 0.1
    frame_drop: float = 0.0  # share of frames lost
    camera: str = "kinect"  # or "small": a quarter of the resolution, for tests


@dataclass(frozen=True)
class Faults:
    """Faults by trial number (from 1)."""

    camera_timeout: tuple[int, ...] = ()
    arm_reflex: tuple[int, ...] = ()
    pedal_release: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class World:
    """One lab to adapt to. Learning and tracking never read it."""

    name: str
    task: str
    description: str
    parameters: Array  # (p,) true values, in units
    nuisance: Array  # (n,)
    unmodelled: Any  # an instance of the task's `unmodelled`
    sensing: Sensing
    faults: Faults
