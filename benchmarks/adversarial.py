"""Hard paths against both arms, judged by code of its own: does anything beyond a limit reach a driver?

    PYTHONPATH=tests/support python benchmarks/adversarial.py --count 10000

Half of them for each arm, in blocks with a seed each; every accepted path is also stopped at a random moment, and the
stop judged (`tests/support/hunt.py`, `own_judge.py`). Prints the sum after every block; ends with status 1 if anything
was wrong.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter

from hunt import Found, hunt

BLOCK = 250


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=2)
    asked = parser.parse_args()
    total = Found()
    for block in range(-(-asked.count // BLOCK)):
        model = ("panda", "fr3")[block % 2]
        found = hunt(model, min(BLOCK, asked.count - block * BLOCK), asked.seed + block)
        total.reached += found.reached
        total.refused += found.refused
        total.stops += found.stops
        total.longest_stop_s = max(total.longest_stop_s, found.longest_stop_s)
        total.wrong += found.wrong
        tell(total)
    for text in total.wrong:
        sys.stdout.write(f"WRONG {text}\n")
    kinds = Counter(total.reached) + Counter(total.refused)
    for kind in kinds:
        sys.stdout.write(f"{kind}: {total.reached[kind]} of {kinds[kind]} accepted\n")
    return 1 if total.wrong else 0


def tell(total: Found) -> None:
    offered = total.reached.total() + total.refused.total()
    sys.stdout.write(
        f"{offered} paths: {total.reached.total()} accepted, {total.stops} stopped (longest "
        f"{total.longest_stop_s:.3f} s), {len(total.wrong)} wrong\n"
    )
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
