"""How long one cycle of the player takes: worst, 99.99th percentile and median of many cycles, including stops.

    sudo python benchmarks/player_timing.py --busy 2

A cycle is what the program does between a state of the arm and the joints that it commands (`Playback.step`, with the
pipe on which the program is heard). Every motion is stopped at another of its moments. No arm and no network take part;
`--busy` starts this many processes that compute all the time.

Cycles come a thousand times a second, and the process has the same rights as the player of a real arm
(`hw.franka.realtime`): real-time priority, locked memory, one core, and a processor that stays awake. Any kernel will
do; delays by it or by the host of a virtual machine are included. A fixed computation of similar length, timed beside
every cycle, shows how large they are ("the computer alone").
"""

from __future__ import annotations

import argparse
import gc
import multiprocessing
import os
import tempfile
import time
from pathlib import Path

import numpy as np

from hw.franka import realtime
from hw.franka.playback import Playback, motion_of
from hw.types import Array, JointPath
from hw.watchdog import ALIVE, PEDAL, Watchdog
from hw.workcell import Workcell
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
CHANGE = np.array([0.25, -0.15, 0.2, 0.1, 0.25, 0.15, -0.25])
DURATION_S = 1.0
PERIOD_S = 0.001
FIXED = 400


class Following:
    """The state of an arm that follows at once."""

    def __init__(self) -> None:
        self.q, self.q_d, self.dq = READY.tolist(), READY.tolist(), [0.0] * 7
        self.tau_ext_hat_filtered = [0.0] * 7
        self.control_command_success_rate = 1.0


def path() -> JointPath:
    t_s = np.arange(round(DURATION_S * 1000) + 1) / 1000
    u = t_s / t_s[-1]
    return JointPath(t_s, READY + (u**4 * (35 - 84 * u + 70 * u**2 - 20 * u**3))[:, None] * CHANGE)


def arithmetic() -> float:
    value = 0.0
    for _ in range(FIXED):
        value = value * 0.999 + 1.0
    return value


def cycles(cell: Workcell, count: int) -> tuple[dict[str, Array], int]:
    """Times of at least `count` cycles in s, and of the arithmetic; and the number of stopped motions."""
    motion = motion_of(path(), cell.motion)
    player, alone, stops = list[float](), list[float](), 0
    heard, said = os.pipe()
    rng = np.random.default_rng(0)
    while len(player) < count:
        listener, state = Watchdog(heard, 60.0), Following()
        playback = Playback(motion, listener.stop_reason, time.monotonic)
        stop_at, tick, finished = int(rng.integers(0, len(motion.path.t_s) - 50)), 0, False
        gc.collect()
        gc.disable()
        due_s = time.perf_counter()
        while not finished:
            due_s = max(due_s + PERIOD_S, time.perf_counter())
            time.sleep(max(0.0, due_s - time.perf_counter()))
            os.write(said, PEDAL if tick >= stop_at else ALIVE)
            began_s = time.perf_counter()
            q_rad, finished = playback.step(state, 0.001 if tick else 0.0)
            player.append(time.perf_counter() - began_s)
            began_s = time.perf_counter()
            arithmetic()
            alone.append(time.perf_counter() - began_s)
            state.dq = [1000.0 * (new - old) for new, old in zip(q_rad, state.q, strict=True)]
            state.q, tick = q_rad, tick + 1
        gc.enable()
        stops += playback.played().braked_at >= 0
    os.close(heard)
    os.close(said)
    return {"the player": np.array(player), "the computer alone": np.array(alone)}, stops


def as_player() -> tuple[str, ...]:
    """Request the same priority, memory and core as the player of a real arm. -> a sentence for each that this computer
    refuses.
    """
    with tempfile.NamedTemporaryFile("w") as flag:  # any kernel will do here
        flag.write("1")
        flag.flush()
        realtime.claim(Path(flag.name))
    return realtime.settle()


def burn() -> None:
    while True:
        pass


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cycles", type=int, default=100_000)
    parser.add_argument("--busy", type=int, default=0)
    options = parser.parse_args()
    cell = cell_as_shipped(get_task("pushing").require_hardware(), "panda")
    others = [multiprocessing.Process(target=burn, daemon=True) for _ in range(options.busy)]
    for other in others:
        other.start()
    missing = as_player()
    try:
        times, stops = cycles(cell, options.cycles)
    finally:
        for other in others:
            other.kill()
    load = os.getloadavg()[0]
    print(
        f"{len(times['the player'])} cycles, {stops} stops among them; {options.busy} busy processes, load {load:.1f}"
    )
    print("  with real-time priority, at 1 kHz", *missing, sep="; ")
    for name, taken_s in times.items():
        us = 1e6 * np.quantile(taken_s, [0.5, 0.9999, 1.0])
        print(f"  {name:<20} median {us[0]:.1f} µs, 99.99 % {us[1]:.0f} µs, worst {us[2]:.0f} µs")


if __name__ == "__main__":
    main()
