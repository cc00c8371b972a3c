"""A touch-off rig on the simulated lab, with as few touches as a result needs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from touch_off import rig_of

from adaptsim_cli.bench.touch_off.parts import Plan, TouchRig
from hw.collision import KeepOut
from sim.lab.simulated import READY_RAD
from sim.lab.touch import TouchLab
from sim.lab.world import Faults, Mount, World, load_world
from sim.panda.tool import cell_as_shipped, empty_hand, touchable
from sim.panda.touching import table_probes, tool_probes
from sim.tasks import get_task

TASK = get_task("scooping")
HARDWARE = TASK.require_hardware()
MOUNT = Mount(table_height_mm=-5.0, table_rise_mrad=(3.0, -2.0), tool_height_mm=2.0, tool_roll_mrad=8.0)
PITCH_RAD = 0.04


def world(mount: Mount = MOUNT, faults: Faults | None = None) -> World:
    effects = TASK.unmodelled(pitch_bias_rad=PITCH_RAD)
    return replace(load_world("wd", TASK), mount=mount, unmodelled=effects, faults=faults or Faults())


def few() -> Plan:
    """Three places of the table; both corners of the edge, one of the heel, and one edge at the other pitch."""
    touched = touchable(HARDWARE)
    every = tool_probes(touched.feelers, touched.centre_m)
    return Plan(table_probes(touched.centre_m)[:3], (every[0], every[1], every[2], every[4]))


@contextmanager
def on_lab(of: World, things: tuple[KeepOut, ...] = ()) -> Iterator[tuple[TouchRig, TouchLab]]:
    cell = cell_as_shipped(HARDWARE, "panda").holding(empty_hand())
    with TouchLab(TASK, of, 1, cell, home_q_rad=READY_RAD, things=things) as lab:
        yield rig_of(lab, cell, few()), lab
