"""The lab of scooping's plainest world, seen by the small camera."""

from __future__ import annotations

from dataclasses import replace

from sim.lab.world import Faults, Sensing, World, load_world
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

TASK = get_task("scooping")
CELL = cell_as_shipped(TASK.require_hardware(), "panda")
XY_M = TASK.reference_context


def world(faults: Faults | None = None) -> World:
    return replace(load_world("wd", TASK), sensing=Sensing(camera="small"), faults=faults or Faults())
