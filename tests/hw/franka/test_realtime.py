"""What the computer gives the player, each time in a process of its own; and what is said where it does not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

PROGRAM = """
import json, os, resource, sys
from pathlib import Path
from hw.franka import realtime
latency, isolated, memlock = sys.argv[1:]
if memlock:
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (int(memlock), int(memlock)))
    os.setresuid(65534, 65534, 65534)
notes = realtime.settle(Path(latency), Path(isolated))
status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
held = [str(one.resolve()) for one in Path("/proc/self/fd").iterdir() if one.exists()]
print(json.dumps([notes, int(status["VmLck"].split()[0]), sorted(os.sched_getaffinity(0)), latency in held]))
"""


def settled(latency: Path, isolated: Path, memlock: str = "") -> tuple[list[str], int, list[int], bool]:
    command = [sys.executable, "-c", PROGRAM, str(latency), str(isolated), memlock]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    result: Any = json.loads(done.stdout)
    return tuple(result)


def test_memory_core_and_processor_are_held_or_it_is_said(tmp_path: Path) -> None:
    latency = tmp_path / "cpu_dma_latency"
    latency.write_bytes(b"\x01" * 4)
    cores = sorted(os.sched_getaffinity(0))
    notes, locked_kb, kept, held = settled(latency, tmp_path / "none")
    assert held
    assert latency.read_bytes() == bytes(4)
    assert (locked_kb > 5_000) != any("memory is not locked" in note for note in notes)
    if len(cores) > 1:
        assert kept == cores[-1:]
    else:
        assert any("only core" in note for note in notes)


def test_a_core_that_the_kernel_leaves_alone_is_taken(tmp_path: Path) -> None:
    cores = sorted(os.sched_getaffinity(0))
    isolated = tmp_path / "isolated"
    isolated.write_text(f"{cores[0]}\n")
    _, _, kept, _ = settled(tmp_path / "none", isolated)
    assert kept == cores[:1]


def test_what_is_not_permitted_is_a_sentence(tmp_path: Path) -> None:
    notes, _, _, held = settled(tmp_path / "none", tmp_path / "none", "8388608" if os.geteuid() == 0 else "")
    assert not held
    assert any("may fall asleep between two cycles" in note and "60-realtime.rules" in note for note in notes)
    if os.geteuid() == 0:
        assert any("memory is not locked (8 MB are allowed): give your user" in note for note in notes)
