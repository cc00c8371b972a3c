"""Freed pictures leave the program, whoever had them."""

from __future__ import annotations

import subprocess
import sys

import pytest

from hw.computer import return_pictures, trim

PROGRAM = """
import threading, numpy as np
from hw.computer import return_pictures
{}
def held_mb():
    line = next(line for line in open("/proc/self/smaps_rollup") if line.startswith("Pss_Anon"))
    return int(line.split()[1]) / 1024
def compress():
    pictures = [np.ones((720, 1280, 3), np.uint8) for _ in range(20)]
    kept.append(np.ones(1000))
kept = []
before = held_mb()
for _ in range(8):
    thread = threading.Thread(target=compress); thread.start(); thread.join()
print(held_mb() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what a program holds")
def test_pictures_of_a_thread_are_returned():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format("return_pictures()")], check=True, capture_output=True, text=True
    )
    assert float(done.stdout) < 5.0


def test_without_glibc_nothing_happens(monkeypatch):
    monkeypatch.setattr("hw.computer.ctypes.CDLL", lambda name: object())
    return_pictures()
    trim()
