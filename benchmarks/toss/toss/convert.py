"""The file of tosses from the public recordings: python -m toss.convert FOLDER tosses.npz.

FOLDER is `assets/contactnets_cube` of https://github.com/DAIRLab/dair_pll at commit 523d372, with one tensor per toss
(`0.pt` to `549.pt`; the extra `learn` reads them). The 285 tosses of the experiment were once drawn at random from the
550, and the seed was not kept, so `numbers.txt` beside this file names them.
"""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

NUMBERS = tuple(map(int, Path(__file__).with_name("numbers.txt").read_text(encoding="utf-8").split()))
"""The 285 recordings, by the numbers of their files."""

STATE_SHA256 = "65e64e7b09254599e50ecc2a91bec6ad4c03ea3c6e12bebf5ff334c5550c7506"
"""Of the bytes of `state` in the file with which docs/results/tosses.md was made."""


def convert(folder: Path, target: Path, numbers: Sequence[int] = NUMBERS) -> str:
    """Write the tosses of these numbers into one NPZ file; the SHA-256 of its states.

    Raises ValueError naming a recording that is missing or has another shape.
    """
    runs = []
    for number in numbers:
        path = folder / f"{number}.pt"
        if not path.is_file():
            raise ValueError(f"{path} is missing: name the folder assets/contactnets_cube of dair_pll")
        run = torch.load(path, weights_only=True).numpy().astype(np.float32)  # reads tensors and nothing else
        if run.ndim != 2 or run.shape[1] != 13:
            raise ValueError(f"{path}: its shape is {run.shape}, and (samples, 13) is needed; use commit 523d372")
        runs.append(run)
    state = np.concatenate(runs)
    start = np.cumsum([0, *map(len, runs)], dtype=np.int32)
    np.savez_compressed(target, state=state, start=start, number=np.array(numbers, dtype=np.int32))
    return hashlib.sha256(state.tobytes()).hexdigest()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write the file of tosses from the public recordings.")
    parser.add_argument("folder", type=Path, help="assets/contactnets_cube of dair_pll")
    parser.add_argument("target", type=Path, help="the file to write, for example tosses.npz")
    arguments = parser.parse_args()
    same = convert(arguments.folder, arguments.target) == STATE_SHA256
    kind = "the same states as" if same else "OTHER STATES than"
    print(f"Written: {arguments.target}, with {kind} the file of docs/results/tosses.md")
