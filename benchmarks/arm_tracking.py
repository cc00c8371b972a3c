"""The FR3's driver over its network protocol: late cycles, and from a released pedal to standstill.

The arm is franky-sim's (MuJoCo), in a process of its own, at 1 kHz and without waiting for late commands; the pedal is
a real serial line (a pseudo-terminal). Without a real-time kernel late cycles are those of this computer and its other
work. They show that the driver adds none.

    PYTHONPATH=tests/support python benchmarks/arm_tracking.py --releases 4
"""

from __future__ import annotations

import argparse
import json
import os
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import numpy as np
from fr3_process import RELAXED, Fr3Process, arm_at, fr3
from serial_lines import Box, boxed, plugged_in

from hw.collision import Tool
from hw.errors import MotionRefused, StoppedByPedal
from hw.serial.enable_pedal import EnablePedal
from hw.serial.pedal_protocol import PERIOD_S
from hw.types import Array, JointPath
from sim.panda.planning import home, trial_paths
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task


def press(box: Box, pedal: EnablePedal) -> None:
    while not pedal.enabled():  # it has to be seen released first
        box.pressed = False
        time.sleep(2 * PERIOD_S)
        box.pressed = True
        time.sleep(2 * PERIOD_S)


def trial(name: str) -> tuple[tuple[JointPath, ...], Tool]:
    """Approach, task path and retreat of a middling action, and the tool of the task."""
    task = get_task(name)
    hardware = task.require_hardware()
    cell = cell_as_shipped(hardware, "fr3")
    motion = hardware.plan(task.reference_context, task.action.middle)
    q_home = home(hardware.X_FT, cell, hardware.home_pitch_rad)
    return trial_paths(motion, hardware.X_FT, cell, q_home, carries=hardware.carries), cell.tool


def track(server: Fr3Process, name: str) -> dict[str, object]:
    """The task path of one trial, and its cycles without an answer in time."""
    (_, path, _), tool = trial(name)
    server.place(path.q_rad[0])
    with arm_at(server, tool=tool) as arm:
        played = arm.execute(path)
    rows = server.received()
    missing = [q is None for q in rows[1:]]  # none is due in the cycle that starts the motion
    run = max((len(part) for part in "".join("x" if m else " " for m in missing).split()), default=0)
    return {
        "task": name,
        "duration_s": path.duration_s,
        "cycles": len(missing),
        "late_cycles": int(sum(missing)),
        "longest_run_of_late_cycles": run,
        "control_success_rate": played.control_success_rate,
    }


def stop(server: Fr3Process, name: str, trials: int) -> dict[str, object]:
    """Release the pedal at moments spread over the task path."""
    (_, path, _), tool = trial(name)
    reports, to_brake_s, silent, released_s = [], [], 0, 0.0
    with plugged_in() as line, boxed(line) as box, ExitStack() as stack:

        def release() -> None:
            nonlocal released_s
            box.pressed, released_s = False, time.monotonic()

        threading.Timer(0.1, lambda: setattr(box, "pressed", True)).start()
        pedal = stack.enter_context(EnablePedal(line.port))
        arm = stack.enter_context(arm_at(server, tool=tool, pedal=pedal))
        moments_s = list(np.linspace(0.25, 0.75, trials) * path.duration_s)
        while moments_s:
            arm.recover()
            server.place(path.q_rad[0])
            server.at(float(moments_s[0]), release)
            released_s = 0.0
            press(box, pedal)
            with suppress(StoppedByPedal, MotionRefused):
                arm.execute(path)
            report = arm.last_stop
            if report is None or not 0.0 < released_s < report.braked_clock_s:
                silent += 1  # this computer was too busy for a line every 20 ms: the pedal fell silent by itself
                continue
            moments_s.pop(0)
            reports.append(report)
            to_brake_s.append(report.braked_clock_s - released_s)
    to_still_s = [b - r.braking_after_s + r.still_after_s for b, r in zip(to_brake_s, reports, strict=True)]
    return {
        "task": name,
        "releases": trials,
        "fell_silent_instead": silent,
        "release_to_braking_ms": spread(1e3 * np.array(to_brake_s)),
        "release_to_standstill_ms": spread(1e3 * np.array(to_still_s)),
        "way_of_the_flange_mm": spread(1e3 * np.array([r.way_m for r in reports])),
    }


def spread(values: Array) -> dict[str, float]:
    return {"median": float(np.median(values)), "max": float(values.max())}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--releases", type=int, default=10, help="of the pedal, per task")
    releases = parser.parse_args().releases
    kernel = Path("/sys/kernel/realtime").exists()
    print(f"real-time kernel: {kernel}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; relaxed: {RELAXED}")
    with fr3(pace="exact") as server:
        for name in ("pushing", "scooping"):
            print(json.dumps(track(server, name), default=float))
            print(json.dumps(stop(server, name, releases), default=float))


if __name__ == "__main__":
    main()
