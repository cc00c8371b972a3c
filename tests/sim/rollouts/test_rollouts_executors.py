"""A pool's processes end with the process that opened it, even when that one is killed."""

from __future__ import annotations

import select
import signal
import subprocess
import sys

from sim.rollouts.executors import process_pool

_OPENS_A_POOL = """
import os
from sim.rollouts.executors import process_pool

if __name__ == "__main__":
    with process_pool(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        input()
"""


def _ignores_interrupts() -> bool:
    return signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_workers_leave_interrupts_to_their_parent() -> None:
    with process_pool(1) as pool:
        assert pool.submit(_ignores_interrupts).result()


def test_workers_do_not_outlive_a_killed_parent(tmp_path) -> None:
    script = tmp_path / "opens_a_pool.py"
    script.write_text(_OPENS_A_POOL)
    parent = subprocess.Popen(
        [sys.executable, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    assert parent.stdin is not None and parent.stdout is not None
    int(parent.stdout.readline())  # the worker is up
    parent.kill()
    # The worker, and the tracker beside it, hold the same pipe: its end is reached only once all of them are gone.
    ended, _, _ = select.select([parent.stdout], [], [], 60)
    assert ended and parent.stdout.read() == ""
    parent.wait()
    parent.stdin.close()
    parent.stdout.close()
