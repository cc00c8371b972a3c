"""A process with one connection to the hand: `python -m hw.franka.hand_worker`, started by `hw.franka.hand_keeper`.

An SDK may hold Python's global lock until the fingers stand still, which can take minutes. Nothing else runs in this
process, and the system ends it with its keeper.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection

from hw.child import Call
from hw.errors import DeviceUnavailable, HandError
from hw.franka.hand import OPEN, STATE, Answer, FrankaHand
from hw.franka.versions import PACKAGES, load
from hw.watchdog import die_with_parent


def serve(keeper: Connection) -> None:
    """Answer calls, each with the hand's state or its error, until the keeper hangs up."""
    hand: FrankaHand | None = None
    with suppress(EOFError, OSError):
        while True:
            call: Call = keeper.recv()
            answer: Answer
            try:
                if call.method == OPEN:
                    model, host = call.arguments
                    hand = FrankaHand(host, partial(load, PACKAGES[model]))
                    hand.__enter__()
                assert hand is not None, "it is opened first"
                if call.method not in (OPEN, STATE):
                    getattr(hand, call.method)(*call.arguments)
                answer = hand.state()
            except (HandError, DeviceUnavailable) as error:
                answer = error
            keeper.send(answer)


def main(connection_fd: str, _pipe_fd: str, parent: str) -> None:
    """Serve one keeper; the arguments are file descriptors and the keeper's process."""
    die_with_parent(int(parent))
    with Connection(int(connection_fd)) as keeper:
        serve(keeper)


if __name__ == "__main__":
    main(*sys.argv[1:])
