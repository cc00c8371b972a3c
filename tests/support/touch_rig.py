"""A world of the simulated lab whose table and tool are displaced, and a person who sets the tool down in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from players import InstantArm

from hw.types import Array
from hw.workcell import arm_model
from sim.lab.simulated import READY_RAD
from sim.lab.touch import set_down_q_rad
from sim.lab.world import Mount, World, load_world
from sim.panda.setting_down import set_downs
from sim.panda.tool import cell_as_shipped, feeling, touchable
from sim.tasks import get_task

TASK = get_task("scooping")
HARDWARE = TASK.require_hardware()
MOUNT = Mount(table_height_mm=-5.0, table_rise_mrad=(3.0, -2.0), tool_height_mm=2.0, tool_roll_mrad=8.0)
PITCH_RAD = 0.04
TOUCHED = touchable(HARDWARE)
PLACES = set_downs(TOUCHED.feelers, TOUCHED.centre_m)
CELL = cell_as_shipped(HARDWARE, "panda").holding(feeling(HARDWARE))
CREATED = "2026-01-01T00:00:00+00:00"


def world(mount: Mount = MOUNT) -> World:
    effects = TASK.unmodelled(pitch_bias_rad=PITCH_RAD)
    return replace(load_world("wd", TASK), mount=mount, unmodelled=effects)


def shown(of: World, seed: int = 0, model: str = "panda") -> list[Array]:
    """(7,) joints of every set-down in a world."""
    rng, q_rad, at = np.random.default_rng(seed), READY_RAD, arm_model(model, np.zeros(7))
    found = []
    for place in PLACES:
        q_rad = set_down_q_rad(place, of, HARDWARE.X_FT, at, q_rad, rng)
        found.append(q_rad)
    return found


class Guided:
    """A person at the terminal: each Enter comes with the next posture; another answer leaves the arm where it is."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, arm: InstantArm, steps: list[tuple[str, Array | None]]) -> None:
        self._arm, self._steps = arm, iter(steps)
        monkeypatch.setattr("sys.stdin", self)
        monkeypatch.setattr("adaptsim_cli.screen.console.read_line", self.answer)

    def answer(self) -> str:
        typed, q_rad = next(self._steps)
        if q_rad is not None:
            self._arm.player.q_rad = np.array(q_rad)
        return f"{typed}\n"


def plain(postures: list[Array]) -> list[tuple[str, Array | None]]:
    return [("", q) for q in postures]
