"""A program whose hand closes slowly, for tests that end it meanwhile: `python hand_program.py MODEL HOST`."""

from __future__ import annotations

import signal
import sys

from hw.errors import HandError
from hw.franka.hand_process import HandProcess


def main(model: str, host: str) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a program in the background is born deaf to it
    with HandProcess(model, host) as hand:
        hand.home()
        sys.stdout.write("homed\n")
        sys.stdout.flush()
        try:
            hand.move(0.01)
        except HandError as error:
            sys.stdout.write(f"{error}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
