"""A process with one connection to the hand: `python -m hw.franka.hand_worker`, started by `hw.franka.hand_keeper`.

An SDK may hold Python's global lock until the fingers stand still, which can take minutes. Nothing else runs in this
process, and the system ends it with its keeper.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from multiprocessing.connection import Connection

from hw.errors import DeviceUnavailable, HandError
from hw.franka.hand import SDKS, FrankaHand
from hw.franka.hand_messages import Answer, Done, Grasp, Home, Move, NotDone, Open, Request, Stop
from hw.watchdog import die_with_parent


def serve(keeper: Connection) -> None:
    """Answer requests until the keeper hangs up."""
    hand: FrankaHand | None = None
    with suppress(EOFError, OSError):
        while True:
            request: Request = keeper.recv()
            answer: Answer
            try:
                if isinstance(request, Open):
                    hand = FrankaHand(request.host, SDKS[request.model])
                    hand.__enter__()
                assert hand is not None, "it is opened first"
                if isinstance(request, Home):
                    hand.home()
                elif isinstance(request, Move):
                    hand.move(request.width_m)
                elif isinstance(request, Grasp):
                    hand.grasp(request.width_m, request.force_N)
                elif isinstance(request, Stop):
                    hand.stop()
                answer = Done(hand.state())
            except HandError as error:
                answer = NotDone(str(error))
            except DeviceUnavailable as error:
                answer = NotDone(str(error), lost=True)
            keeper.send(answer)


def main(connection_fd: str, _pipe_fd: str, parent: str) -> None:
    """Serve one keeper; the arguments are file descriptors and the keeper's process."""
    die_with_parent(int(parent))
    with Connection(int(connection_fd)) as keeper:
        serve(keeper)


if __name__ == "__main__":
    main(*sys.argv[1:])
