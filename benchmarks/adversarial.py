"""Hard paths for both arms, checked by independent code: does anything beyond a limit reach a driver?

    PYTHONPATH=tests/support python benchmarks/adversarial.py --count 10000 --out hunt.jsonl

Half of them for each arm, in blocks with a seed each; every accepted path is also stopped at a random moment, and the
stop is checked (`hunt` in `tests/support/hard_paths.py`). Prints the sum after every block; ends with status 1 if
anything was wrong. `--out` stores a line for each block; the same command skips those and continues.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

from hard_paths import Found, hunt
from kept import Kept

BLOCK = 250


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    store, total = Kept(asked.out), Found()
    for block in range(-(-asked.count // BLOCK)):
        seed, model, count = asked.seed + block, ("panda", "fr3")[block % 2], min(BLOCK, asked.count - block * BLOCK)
        row = store.row(model, seed, partial(hunted, model, count, seed))
        total.reached.update(row["reached"])
        total.refused.update(row["refused"])
        total.stops += row["stops"]
        total.longest_stop_s = max(total.longest_stop_s, row["longest_stop_s"])
        total.wrong += row["wrong"]
        tell(total)
    for text in total.wrong:
        sys.stdout.write(f"WRONG {text}\n")
    kinds = Counter(total.reached) + Counter(total.refused)
    for kind in kinds:
        sys.stdout.write(f"{kind}: {total.reached[kind]} of {kinds[kind]} accepted\n")
    return 1 if total.wrong else 0


def hunted(model: str, count: int, seed: int) -> dict[str, Any]:
    return vars(hunt(model, count, seed))


def tell(total: Found) -> None:
    offered = total.reached.total() + total.refused.total()
    sys.stdout.write(
        f"{offered} paths: {total.reached.total()} accepted, {total.stops} stopped (longest "
        f"{total.longest_stop_s:.3f} s), {len(total.wrong)} wrong\n"
    )
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
