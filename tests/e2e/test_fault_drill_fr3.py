"""Every fault of an arm and of its pedal through the real path, and the same command that goes on afterwards.

`adaptsim run-iteration --hw fr3` at a pseudo-terminal, a rig file, the FR3 adapter and its player process talking to
franky-sim over the maker's protocol, the enabling pedal on a serial line. The table of docs/guide/faults.md names these
tests. One particle, so an iteration has two trials; a fault on a real arm always spends the attempt.
"""

from __future__ import annotations

import re
import signal
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from fr3_session import START, Before, Command, Drill, Ended, drilling, until

from hw.types import Array

pytestmark = pytest.mark.slow
CONTINUE = "Continue with: adaptsim run-iteration --session s"
THEN = "look at the arm and recover it, then redo the trial"
REVIEW = "Enter to accept, o to amend the outcome, r to reject it, q to stop, ? explains:"
AT_S = 0.4
"""Into the motion, as the arm counts its time."""


@pytest.fixture
def drill(tmp_path) -> Iterator[Drill]:
    with drilling(tmp_path) as there:
        yield there


def at_first(motion: str, fault: Callable[[Command], object]) -> Before:
    """`fault` is armed before the first motion of that name."""
    armed: list[str] = []

    def before(now: str, command: Command) -> None:
        if now == motion and not armed:
            armed.append(now)
            fault(command)

    return before


def own(fault: str) -> Callable[[Command], object]:
    """A fault of the program's own camera or disk, from that motion on."""
    return lambda command: setattr(command, "fault", fault)


def stands(drill: Drill) -> Array:
    """(M, 7) what the arm was commanded in its last motion. Fails unless the commands end, with the arm at rest."""
    until(lambda: not drill.arm.moves())
    commanded: Array = drill.arm.commanded()
    assert 1000 * AT_S * 0.8 < len(commanded) < 4000, "it began, and did not play to its end"
    return commanded


def braked(commanded: Array) -> bool:
    return bool(np.abs(np.diff(commanded[-10:], axis=0)).max() < 1e-6)


def told(ended: Ended, code: int, *words: str) -> None:
    assert ended.code == code, ended.said
    by_person = any(word.startswith(("stopped by the operator", "interrupted")) for word in words)
    assert ended.said.count("Error: ") == (not by_person)
    assert "Traceback" not in ended.said
    assert ended.data == []
    for pattern in (*words, CONTINUE):
        assert re.search(pattern, ended.error, re.IGNORECASE), ended.error


def goes_on(drill: Drill) -> Ended:
    """The same command comes to the next question about a motion; there it is stopped, to save the time."""
    ended = drill.run(answers={START: "q"})
    told(ended, 7, "stopped by the operator; everything completed is stored")
    return ended


def test_a_reflex_and_a_released_pedal_spend_an_attempt_each_and_the_session_comes_to_its_end(drill):
    reflex = drill.run(at_first("approach", lambda _: drill.arm.tell(f"reflex {AT_S} joint_reflex")))
    told(reflex, 5, r"fr3 stopped 0\.\d+ s into the path: .*joint_reflex.*check what it touched.*clear it", THEN)
    stands(drill)

    pedal = drill.run(at_first("approach", lambda _: drill.arm.at(AT_S, drill.pedal.release)))
    assert "Type recover to clear it" in pedal.said, "the reflex is cleared by a person's word"
    still = r"the enabling pedal was released .* the arm stood still after \d+ ms and \d+\.\d mm"
    told(pedal, 7, still, THEN)
    assert braked(stands(drill))
    assert drill.completed() == {}

    whole = drill.run()
    assert whole.code == 0, whole.said
    (summary,) = whole.data
    assert [len(p["trials"]) for p in summary["particles"]] == [2]
    assert sorted(drill.completed()) == ["trial-001-attempt-3", "trial-002-attempt-1"]
    assert [bool(re.search(w, r)) for w, r in zip(("reflex", "pedal"), drill.rejected(), strict=True)] == [True, True]


def test_the_stop_button_is_waited_for_by_the_same_command(drill):
    pressed = drill.run(at_first("approach", lambda _: drill.arm.at(AT_S, lambda: drill.arm.tell("press"))))
    told(pressed, 5, "the stop button was pressed", THEN)
    stands(drill)

    def released() -> str:
        drill.arm.tell("release")
        return ""

    again = drill.run(answers={"Enter when done, q to stop, ? explains:": released, START: "q"})
    told(again, 7, "stopped by the operator; everything completed is stored")
    assert "The arm reports: the stop button is pressed" in again.said
    assert "Type recover" not in again.said, "an arm whose button is released is Idle: there is nothing to clear"
    goes_on(drill)
    assert len(drill.rejected()) == 1


def test_a_pedal_that_falls_silent_or_is_pulled_out_brakes_the_arm(drill):
    silent = drill.run(at_first("approach", lambda _: drill.arm.at(AT_S, drill.pedal.fall_silent)))
    told(silent, 7, "the enabling pedal was released", THEN)
    assert braked(stands(drill))
    drill.pedal.silent = False

    pulled = drill.run(at_first("approach", lambda _: drill.arm.at(AT_S, drill.pedal.unplug)))
    told(pulled, 7, "the enabling pedal was released", THEN)
    assert braked(stands(drill))

    missing = drill.run()
    assert missing.code == 3, missing.said
    assert "cannot be opened" in missing.error
    drill.pedal.plug_in()
    goes_on(drill)
    assert len(drill.rejected()) == 2


def test_a_network_that_is_lost_for_a_moment_and_for_good(drill):
    moment = drill.run(at_first("approach", lambda _: drill.arm.at(AT_S, lambda: drill.arm.signal(signal.SIGSTOP))))
    told(moment, 5, "does not answer .*check cable, address and power", THEN)
    drill.arm.signal(signal.SIGCONT)

    lost = drill.run(at_first("approach", lambda _: drill.arm.at(AT_S, lambda: drill.arm.signal(signal.SIGKILL))))
    told(lost, 5, "does not answer", THEN)
    drill.switch_off()
    nobody = drill.run()
    assert nobody.code == 3, nobody.said
    assert re.search("the hand at .* does not answer .*activate FCI in Desk", nobody.error)
    drill.switch_on()
    goes_on(drill)
    assert len(drill.rejected()) == 2


def test_a_program_killed_half_way_leaves_the_arm_at_rest_and_its_completed_trial_alone(drill):
    def second_task(now: str, command: Command) -> None:
        if now == "task" and drill.completed():
            drill.arm.at(AT_S, lambda: command.signal(signal.SIGKILL))

    killed = drill.run(second_task)
    assert killed.code == -signal.SIGKILL, killed.said
    assert braked(stands(drill)), "the player brakes when nobody speaks to it any more"
    first = drill.completed()
    assert sorted(first) == ["trial-001-attempt-1"]

    whole = drill.run()
    assert whole.code == 0, whole.said
    assert "Have you looked: is the arm at rest and its path clear?" in whole.said
    assert re.search("THE REAL ROBOT .*home", whole.said), "from where it was left, over the table"
    assert first.items() <= drill.completed().items()
    assert len(drill.completed()) == 2
    assert any("interrupted while the arm may have moved" in reason for reason in drill.rejected())


def test_ctrl_c_brakes_the_arm_and_spends_the_attempt(drill):
    ended = drill.run(at_first("approach", lambda command: drill.arm.at(AT_S, lambda: command.signal(signal.SIGINT))))
    told(ended, 130, "interrupted on the way there: the arm brakes and stays there")
    assert braked(stands(drill))
    goes_on(drill)
    assert drill.completed() == {}


def test_a_camera_that_gives_no_frame_stops_before_the_next_motion(drill):
    silent = drill.run(at_first("task", own("camera")))
    told(silent, 6, "no frame within 1 s; check the camera's cable and power")
    until(lambda: not drill.arm.moves())
    assert drill.completed() == {}
    before = drill.run(at_first("home", own("camera")))
    told(before, 6, "no frame within 1 s; check the camera's cable and power")
    assert drill.motions[-1] == "home", "the task has not begun"
    goes_on(drill)
    assert len(drill.rejected()) == 2


def test_a_full_disk_keeps_every_completed_trial(drill):
    def second_task(now: str, command: Command) -> None:
        if now == "task" and drill.completed():
            command.fault = "disk"

    full = drill.run(second_task)
    told(full, 8, "the disk is full: .* free some space and run the same command again")
    first = drill.completed()
    assert sorted(first) == ["trial-001-attempt-1"]
    goes_on(drill)
    assert drill.completed() == first


def test_what_ends_the_program_after_the_motion_costs_nothing(drill):
    """Killed, and then q, at the review: the recording is there, and the review comes again without a motion."""
    running: list[Command] = []

    def kill() -> str:
        running[0].signal(signal.SIGKILL)
        return ""

    killed = drill.run(lambda _, command: running.append(command), {REVIEW: kill})
    assert killed.code == -signal.SIGKILL, killed.said
    assert drill.motions[-1] == "back"
    moved, drill.motions[:] = len(drill.motions), []
    assert moved == 3
    left = drill.run(answers={REVIEW: "q"})
    told(left, 7, "stopped by the operator; this trial is recorded; the same command asks for its review again")
    assert "Trial 1 continues from its recording: the motion is over, nothing moves." in left.said
    assert drill.motions == []
    assert drill.completed() == {}
    goes_on(drill)
    assert sorted(drill.completed()) == ["trial-001-attempt-1"]
    assert drill.rejected() == []


def test_another_calibration_moves_nothing(drill):
    goes_on(drill)
    drill.calibrate(0.005)
    changed = drill.run()
    assert changed.code == 2, changed.said
    assert "the calibration or touch-off has changed since session 's' was begun" in changed.error
    assert drill.arm.received() == []
