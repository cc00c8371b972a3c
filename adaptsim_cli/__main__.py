"""The console script `adaptsim`, the same as `python -m adaptsim_cli`."""

from __future__ import annotations

import gc
import os
import signal
from types import FrameType


def main() -> None:
    """Load the program, and run one command. Ctrl-C while it loads ends it without a traceback."""
    gc.disable()  # until a command runs (`command`), because loading makes many objects and hardly any garbage
    usual = signal.getsignal(signal.SIGINT)
    if usual is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
    from adaptsim_cli.commands import app

    if usual is signal.default_int_handler:
        signal.signal(signal.SIGINT, usual)
    app.main()


def _leave(number: int, frame: FrameType | None) -> None:
    os.write(2, b"\nInterrupted; nothing had begun.\n")
    os._exit(130)


if __name__ == "__main__":
    main()
