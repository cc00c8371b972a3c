"""The process that speaks to the arm, and does nothing else: `python -m hw.franka.player`.

The SDKs hold Python's global lock while a motion runs, and the arm waits only a millisecond for an answer. So the arm
has a process of its own, without camera, policy and screen. The program calls it over a connection. While a motion
runs, the program also writes to a pipe that it is alive (ALIVE) or wants a stop. Silence on the pipe, or its end, stops
the motion too, so a program that hangs or was killed cannot keep the arm moving.
"""

from __future__ import annotations

import gc
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from ipaddress import ip_address
from multiprocessing.connection import Connection
from typing import Any

from hw.child import Call
from hw.errors import DeviceUnavailable
from hw.franka import connection, realtime, versions
from hw.franka.connection import DRIVES
from hw.franka.driver import FAULT, UNAVAILABLE, UNMOVED, Failure, Reading
from hw.franka.playback import STILL_CYCLES, STILL_RAD_S, PlayableMotion, Playback, PlayOutcome, Timing
from hw.franka.settings import FrankaSettings
from hw.franka.starting import HELD_RAD, START_S
from hw.watchdog import Watchdog

CONNECT, PLAY = "connect", "play"
"""The other calls are methods of `hw.franka.connection.Connection`; one without a result is answered with a reading."""

REST_READINGS = 2000
HANDOVER_S = 5.0
"""How long a player may wait for the one before it, which may still have to brake."""


def play(
    driver: connection.Connection,
    motion: PlayableMotion,
    listener: Watchdog,
    start_s: float = START_S,
    sent_s: float | None = None,
    held_rad: float = HELD_RAD,
) -> PlayOutcome:
    """Play `motion`. A failure during the motion is part of the outcome.

    `sent_s` is when the program sent it (`since_boot_s`), None: now; it begins at most `start_s` later or not at all.

    Raises Failure if the arm rejects its settings, or is no longer where the motion begins: nothing has moved.
    """
    interrupted = partial(driver.interruption, motion.checked_s)
    playback = Playback(
        motion,
        listener.stop_reason,
        time.monotonic,
        start_s,
        interrupted=interrupted,
        sent_s=sent_s,
        held_rad=held_rad,
    )
    driver.watch()  # both take a tenth of a second for a long motion
    gc.collect()
    gc.disable()  # no pause of several milliseconds while the arm waits, or while nobody reads its states
    try:
        driver.prepare(motion.checked_s)
        listener.begin()
        failure, rest = _driven(driver, playback)
    finally:
        gc.enable()
    if playback.refused:
        raise Failure(UNMOVED, f"{playback.refused}; nothing has moved")
    return PlayOutcome(playback.played(), failure, rest)


def _driven(driver: connection.Connection, playback: Playback) -> tuple[Failure | None, tuple[Reading, ...]]:
    """Drive the motion to its end; the failure that ended it, and the readings until the arm was at rest."""
    try:
        driver.drive(playback.step)
    except Failure as failure:
        return failure, tuple(wait_for_rest(driver)) if failure.kind == FAULT else ()
    return None, ()


def wait_for_rest(driver: connection.Connection) -> list[Reading]:
    """Read at 1 kHz after the arm stopped by itself, until it stands still or does not answer."""
    still, readings = 0, list[Reading]()
    with suppress(Failure):
        for _ in range(REST_READINGS):
            readings.append(driver.reading())
            moves = max(map(abs, readings[-1].dq_rad_s)) >= STILL_RAD_S
            still = 0 if moves else still + 1
            if still >= STILL_CYCLES:
                break
    return readings


def serve(program: Connection, listener: Watchdog, connect: Callable[..., connection.Connection]) -> None:
    """Answer calls, each with its result or a `Failure`, until the program is gone. `connect` is as below."""
    driver: connection.Connection | None = None
    start_s, held_rad = START_S, HELD_RAD
    while not listener.orphaned:
        try:
            call = _next_call(program, driver)
        except (EOFError, OSError):
            return
        try:
            answer: Any
            if call.method == CONNECT:
                driver, (_, settings, timing) = connect(*call.arguments), call.arguments
                held_rad = settings.starting.held_rad
                start_s = settings.starting.start_s if timing.start_s is None else timing.start_s
                driver.reading()
                answer = driver.notes
            elif driver is None:
                answer = Failure(UNAVAILABLE, "the arm is not connected")
            elif call.method == PLAY:
                motion, sent_s = call.arguments
                answer = play(driver, motion, listener, start_s, sent_s, held_rad)
            else:
                answer = getattr(driver, call.method)(*call.arguments) or driver.reading()
        except Failure as failure:
            answer = failure
        try:
            program.send(answer)
        except OSError:  # the program is gone
            return


def _next_call(program: Connection, driver: connection.Connection | None) -> Call:
    """The program's next call. Until it comes, every state of the arm is read, so that none is missed or grows old."""
    while driver is not None and not program.poll() and driver.watch():
        pass
    call: Call = program.recv()
    return call


def connect(model: str, settings: FrankaSettings, timing: Timing) -> connection.Connection:
    """Connect to the real arm: real-time priority, SDK, arm. Raises Failure."""
    try:
        alone = sole(settings.host)
        if timing.realtime:
            realtime.claim()
        sdk = versions.load(versions.PACKAGES[model])
    except DeviceUnavailable as error:
        raise Failure(UNAVAILABLE, str(error)) from error
    import scipy.interpolate  # noqa: PLC0415, F401 the first motion must not wait for it

    driver = connection.Connection(
        model,
        sdk,
        DRIVES[model],
        settings,
        realtime=timing.realtime and realtime.kernel_has_flag(),  # without that file libfranka would refuse
        unwatched_s=timing.unwatched_s,
        take_priority=realtime.take_priority if timing.realtime else lambda: None,
    )
    driver.alone = alone
    if timing.realtime:
        driver.notes = realtime.settle()  # once everything is loaded
    return driver


class Sole:
    """The lock that keeps other programs of this computer away from an arm, until it is closed or its process ends."""

    def __init__(self, sockets: list[socket.socket]) -> None:
        self._sockets = sockets

    def close(self) -> None:
        """Leave the arm to another program."""
        for one in self._sockets:
            one.close()


def sole(host: str, within_s: float = HANDOVER_S) -> Sole:
    """Reserves the arm at `host` for this process on this computer, however its address is spelled.

    A Unix socket for every address; its name goes with its process, however that ends. Raises DeviceUnavailable.
    """
    alone, until_s = Sole(sockets := []), time.monotonic() + within_s
    for address in addresses(host):
        sockets.append(socket.socket(socket.AF_UNIX))
        while True:
            try:
                sockets[-1].bind(f"\0adaptsim-arm-{address}")
                break
            except OSError as error:
                if time.monotonic() > until_s:
                    alone.close()
                    raise DeviceUnavailable(
                        f"another program on this computer is connected to the arm at {host} ({address}): end that "
                        "one first"
                    ) from error
                time.sleep(0.05)
    return alone


def addresses(host: str) -> list[str]:
    """The network addresses that `host` means, each in its one spelling. Raises DeviceUnavailable if there are none."""
    try:
        entries = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise DeviceUnavailable(
            f"the arm's address {host!r} cannot be resolved ({error}): correct it in the rig file, or give the IP "
            "address"
        ) from error
    plain = (ip_address(str(entry[4][0]).partition("%")[0]) for entry in entries)
    return sorted({str(getattr(one, "ipv4_mapped", None) or one) for one in plain})


def main(connection_fd: str, pipe_fd: str, silence_s: str) -> None:
    """Serve one program until it hangs up; the arguments are file descriptors and a time in seconds."""
    with Connection(int(connection_fd)) as program:
        serve(program, Watchdog(int(pipe_fd), float(silence_s)), connect)


if __name__ == "__main__":
    main(*sys.argv[1:])
