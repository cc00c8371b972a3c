"""Writes the self-test into the cards of checkpoints that were made without it. Trains nothing.

python benchmarks/self_tests.py [FOLDER ...]      by default the shipped ones
"""

from __future__ import annotations

import sys
from pathlib import Path

from sim.adaptation.checkpoint import add_self_test, list_checkpoints

if __name__ == "__main__":
    folders = [Path(name) for name in sys.argv[1:]] or [path for _, _, path in list_checkpoints()]
    for folder in folders:
        print(f"{folder}: {'self-test written' if add_self_test(folder) else 'no emulator, nothing to test'}")
