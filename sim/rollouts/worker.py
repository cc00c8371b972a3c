"""The beginning of a worker process, run by its path: it finds our packages, ignores interrupts, and ends with its
parent.
"""

import ctypes
import runpy
import signal
import sys
from pathlib import Path

_PR_SET_PDEATHSIG = 1

runpy.run_path(str(Path(__file__).parents[2] / "hw" / "own_packages.py"))
signal.signal(signal.SIGINT, signal.SIG_IGN)
if sys.platform == "linux":
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
