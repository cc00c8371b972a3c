"""How soon a hand that moves is stopped: by the pedal, Ctrl-C, a killed program and one that hangs.

    python benchmarks/hand_stops.py --stops 20

The makers' SDKs, over their protocol, against the stand-in of `tests/support/gripper_server.py`; the time runs from the
event to the stop command's arrival at the hand. Only a real hand can show how it then stops.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

from fr3_process import HandPedal  # noqa: E402
from gripper_server import GripperServer, gripper  # noqa: E402

from hw.errors import HandError  # noqa: E402
from hw.franka.hand_process import HandProcess  # noqa: E402

PROGRAM = ROOT / "tests" / "support" / "hand_program.py"
SIGNALS = {"Ctrl-C": signal.SIGINT, "killed": signal.SIGKILL, "hangs": signal.SIGSTOP}


def until(holds: Callable[[], bool]) -> None:
    while not holds():
        time.sleep(0.001)


def by_pedal(server: GripperServer) -> float:
    """Release the pedal in the middle of a motion -> ms until the stop arrived."""
    pedal, before = HandPedal(), len(server.begun_s) + 1
    with HandProcess("fr3", server.host, pedal=pedal) as hand:
        server.slower = 0.1
        hand.home()
        server.slower = 20.0

        def release() -> None:
            until(lambda: len(server.begun_s) > before)
            time.sleep(0.05)
            pedal.release()

        thread = threading.Thread(target=release)
        thread.start()
        try:
            hand.move(0.01)
        except HandError:
            thread.join()
    return 1e3 * (server.stops_s[-1] - pedal.released_s)


def by_signal(server: GripperServer, number: signal.Signals) -> float:
    """Send a signal to a program whose hand moves -> ms until the stop arrived."""
    server.slower, before, stops = 0.1, len(server.begun_s) + 1, len(server.stops_s)
    program = subprocess.Popen(
        [sys.executable, str(PROGRAM), "fr3", server.host],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        text=True,
    )
    assert program.stdout is not None
    program.stdout.readline()
    server.slower = 50.0
    until(lambda: len(server.begun_s) > before)
    time.sleep(0.05)
    sent_s = time.monotonic()
    program.send_signal(number)
    until(lambda: len(server.stops_s) > stops)
    program.kill()
    program.communicate()
    return 1e3 * (server.stops_s[stops] - sent_s)


def main() -> None:
    """Print median and worst of each cause."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stops", type=int, default=20, help="of each cause")
    stops = parser.parse_args().stops
    for cause in ("pedal", *SIGNALS):
        took_ms = []
        for _ in range(stops):
            with gripper() as server:
                took_ms.append(by_pedal(server) if cause == "pedal" else by_signal(server, SIGNALS[cause]))
        took_ms.sort()
        print(f"{cause}: median {took_ms[len(took_ms) // 2]:.0f} ms, worst {took_ms[-1]:.0f} ms of {len(took_ms)}")


if __name__ == "__main__":
    main()
