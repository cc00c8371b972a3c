"""A program with a motion of 3 s under way: `python moving_program.py HOST [PORT]`.

With the PORT of a pedal, it and the player have their real limits of time; else nobody hurries them. When the motion
has ended it says what became of it, as one line of JSON.
"""

from __future__ import annotations

import json
import sys
import time
from contextlib import ExitStack
from dataclasses import replace

from cells import cell, move
from fr3_process import RELAXED

from hw.errors import HardwareError
from hw.franka.arm import franka
from hw.franka.playback import Timing, motion_of
from hw.franka.settings import FrankaSettings
from hw.serial.enable_pedal import EnablePedal

REAL = replace(Timing(), realtime=False, start_s=RELAXED.start_s, unwatched_s=RELAXED.unwatched_s)


def say(**what: object) -> None:
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def main(host: str, port: str = "") -> None:
    path = move([0.5, -0.2, 0.2, 0.2, 0.3, 0.2, -0.4], 3.0)
    for _ in range(3):  # the first checks import SciPy and fetch memory, which holds up the thread of the pedal
        motion_of(path, cell("fr3").motion)
        cell("fr3").require(path, path.q_rad[0])
    with ExitStack() as stack:
        pedal = stack.enter_context(EnablePedal(port)) if port else None
        timing = REAL if port else RELAXED
        arm = stack.enter_context(franka(cell("fr3"), FrankaSettings(host), timing, pedal=pedal))
        player = arm._player.pid  # type: ignore[union-attr]
        say(player=player)
        while pedal is not None and not pedal.enabled():
            time.sleep(0.001)
        error = ""
        try:
            arm.execute(path)
        except HardwareError as refused:
            error = str(refused)
        stop = arm.last_stop
        say(
            error=error,
            why=None if stop is None else stop.why,
            braked_s=None if stop is None else stop.braked_clock_s,
            still_s=None if stop is None else stop.braked_clock_s + stop.still_after_s - stop.braking_after_s,
            enabled=pedal is not None and pedal.enabled(),
            why_not="" if pedal is None else pedal.why_not(),
            success=None if arm.last_execution is None else arm.last_execution.control_success_rate,
        )
        sys.stdin.read()


if __name__ == "__main__":
    main(*sys.argv[1:])
