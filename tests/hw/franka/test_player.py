"""The player's end: what it hears while a motion runs, and what it answers."""

from __future__ import annotations

import os
from collections.abc import Iterator
from multiprocessing import Pipe
from types import SimpleNamespace

import numpy as np
import pytest
from cells import READY, cell, move

from hw.child import Call
from hw.franka.driver import FAULT, UNAVAILABLE, Failure, Reading, Step
from hw.franka.playback import PlayableMotion, PlayOutcome, Rhythm, Timing, motion_of
from hw.franka.player import serve
from hw.franka.settings import FrankaSettings
from hw.watchdog import ALIVE, ORPHANED, PEDAL, REQUESTED, SILENT, Watchdog, since_boot_s


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def pipe() -> Iterator[list[int]]:
    ends = list(os.pipe())
    yield ends
    for end in ends:
        if end >= 0:
            os.close(end)


def test_the_player_goes_on_while_it_hears_that_all_is_well(pipe: list[int]) -> None:
    clock = Clock()
    listener = Watchdog(pipe[0], 0.06, clock)
    listener.begin()
    for _ in range(100):
        clock.now_s += 0.05
        os.write(pipe[1], ALIVE)
        assert listener.stop_reason() == ""


def test_silence_is_a_stop_after_60_ms_and_not_before(pipe: list[int]) -> None:
    clock = Clock()
    listener = Watchdog(pipe[0], 0.06, clock)
    listener.begin()
    clock.now_s = 0.06
    assert listener.stop_reason() == ""
    clock.now_s = 0.0601
    assert listener.stop_reason() == SILENT


@pytest.mark.parametrize(("word", "why"), [(PEDAL, "pedal"), (REQUESTED, "request"), (ALIVE + PEDAL + ALIVE, "pedal")])
def test_a_stop_is_heard_wherever_it_stands(pipe: list[int], word: bytes, why: str) -> None:
    listener = Watchdog(pipe[0], 0.06)
    os.write(pipe[1], word)
    assert listener.stop_reason() == why


def test_what_was_said_before_a_motion_does_not_count(pipe: list[int]) -> None:
    listener = Watchdog(pipe[0], 0.06)
    os.write(pipe[1], PEDAL)
    listener.begin()
    assert listener.stop_reason() == ""


def test_the_end_of_the_program_is_a_stop(pipe: list[int]) -> None:
    listener = Watchdog(pipe[0], 0.06)
    os.close(pipe[1])
    pipe[1] = -1
    assert listener.stop_reason() == ORPHANED
    assert listener.orphaned


class Follower:
    """A driver whose arm follows at once, and fails where it is told to."""

    notes = ("the processor may fall asleep",)

    def __init__(self, fails_at: int = -1) -> None:
        self.q = READY.tolist()
        self.mode, self._fails_at = "Idle", fails_at

    def reading(self) -> Reading:
        return Reading(tuple(self.q), tuple(self.q), (0.0,) * 7, self.mode)

    def prepare(self, checked_s: float) -> None: ...

    def watch(self) -> bool:
        return True

    def interruption(self, checked_s: float, state: object = None) -> str:
        return ""

    def listen(self, states: int) -> Rhythm:
        return Rhythm(states, states // 100, 0.0012, 5, 80)

    def recover(self) -> None:
        self.mode = "Idle"

    def drive(self, step: Step) -> None:
        finished, cycle = False, 0
        while not finished:
            if cycle == self._fails_at:
                self.mode = "Reflex"
                raise Failure(FAULT, "a joint felt more torque")
            state = SimpleNamespace(q=self.q, q_d=self.q, dq=[0.0] * 7, control_command_success_rate=1.0)
            self.q, finished = step(state, 0.001 if cycle else 0.0)
            cycle += 1


def motion(driver: Follower) -> PlayableMotion:
    return motion_of(move(np.full(7, 0.05), 0.5, start_rad=np.array(driver.q)), cell("panda").motion)


def answers(driver: Follower, pipe: list[int], *requests: object) -> list[object]:
    """What a player says to these, one after the other, until its program hangs up."""
    program, player = Pipe()
    for request in requests:
        program.send(request)
    os.write(pipe[1], ALIVE)
    with player:
        heard: list[object] = []

        class Serving:
            """The player's end, closed for asking once everything was asked."""

            def poll(self) -> bool:
                return True

            def recv(self) -> object:
                if not player.poll(0):
                    raise EOFError
                return player.recv()

            def send(self, answer: object) -> None:
                heard.append(answer)

        serve(Serving(), Watchdog(pipe[0], 60.0), lambda *_: driver)  # type: ignore[arg-type]
    program.close()
    return heard


CONNECT = Call("connect", ("panda", FrankaSettings("172.16.0.2"), Timing(start_s=60.0)))


def test_requests_are_answered_in_order(pipe: list[int]) -> None:
    driver = Follower()
    asked = motion(driver)
    connected, before, outcome, after = answers(
        driver, pipe, CONNECT, Call("reading"), Call("play", (asked, since_boot_s())), Call("reading")
    )
    assert connected == Follower.notes
    assert isinstance(before, Reading)
    assert isinstance(outcome, PlayOutcome)
    assert outcome.failure is None
    np.testing.assert_array_equal(outcome.played.q_commanded_rad[:501], asked.path.q_rad)
    assert isinstance(after, Reading)
    np.testing.assert_array_equal(after.q_rad, asked.path.q_rad[-1])


def test_a_fault_keeps_the_log_until_then_and_the_player_goes_on(pipe: list[int]) -> None:
    driver = Follower(fails_at=200)
    asked = motion(driver)
    _, outcome, recovered = answers(driver, pipe, CONNECT, Call("play", (asked, since_boot_s())), Call("recover"))
    assert isinstance(outcome, PlayOutcome)
    assert outcome.failure is not None
    assert outcome.failure.kind == FAULT
    assert len(outcome.played.t_s) == 200
    assert isinstance(recovered, Reading)
    assert recovered.mode == "Idle"
    np.testing.assert_array_equal(recovered.q_rad, asked.path.q_rad[199])


def test_states_are_counted_without_a_motion(pipe: list[int]) -> None:
    driver = Follower()
    before = driver.q.copy()
    _, rhythm = answers(driver, pipe, CONNECT, Call("listen", (1000,)))
    assert rhythm == Rhythm(1000, 10, 0.0012, 5, 80)
    assert driver.q == before


def test_nothing_is_done_before_connecting(pipe: list[int]) -> None:
    (refused,) = answers(Follower(), pipe, Call("reading"))
    assert isinstance(refused, Failure)
    assert refused.kind == UNAVAILABLE
