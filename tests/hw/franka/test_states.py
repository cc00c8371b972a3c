"""No reading that decides something is old, and nothing that a person does to the arm is missed between two of them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from cells import move
from fr3_process import RELAXED, Fr3Process, arm_at
from players import SETTINGS, InProcess, arm_of, driver_of
from sdk_fake import KEPT_STATES, FakeSdk

from hw.errors import ArmFault
from hw.franka.connection import Connection, drive_fr3
from hw.franka.driver import LOST, UNMOVED, Failure
from hw.franka.playback import PlayOutcome
from hw.franka.settings import FrankaSettings
from hw.franka.starting import UNWATCHED_S
from hw.franka.states import WAITED_FOR, States
from hw.types import JointPath

MODELS = ["panda", "fr3"]


def sdk_of(model: str) -> FakeSdk:
    return FakeSdk(k=model == "panda")


def little(q_rad: np.ndarray) -> JointPath:
    return move([0.05, -0.03, 0.03, 0.02, 0.04, 0.03, -0.05], 0.6, start_rad=q_rad)


def commands(sdk: FakeSdk) -> list[Any]:
    return [what for name, what in sdk.calls if name == "command"]


def test_the_stand_in_keeps_the_oldest_states_as_a_socket_does() -> None:
    sdk = sdk_of("fr3")
    robot = sdk.Robot("fr3.test", "kIgnore")
    robot.read_once()
    sdk.idle(3.0)
    old, fresh = robot.read_once().time.to_sec(), robot.read_once().time.to_sec()
    assert old == pytest.approx(0.001 * (1 + KEPT_STATES))
    assert fresh == pytest.approx(3.002)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("idle_s", [0.005, 0.05, 0.1, 1.0, 300.0])
def test_after_any_pause_a_reading_is_of_now(model: str, idle_s: float) -> None:
    sdk = sdk_of(model)
    driver = driver_of(sdk, model)
    driver.reading()
    sdk.idle(idle_s - 0.001)
    sdk.robot._q[0] += 0.2
    sdk.idle(0.001)
    began_s = sdk.now_s
    reading = driver.reading()
    assert reading.q_rad[0] == pytest.approx(0.2), "one that was kept does not know of it"
    assert began_s <= reading.at_s + 1e-9
    assert sdk.now_s - began_s < 0.01


@pytest.mark.parametrize("model", MODELS)
def test_a_button_that_was_pressed_in_a_pause_is_reported_at_once_and_so_is_its_release(model: str) -> None:
    sdk = sdk_of(model)
    with arm_of(sdk, model) as arm:
        assert arm.state().fault is None
        sdk.idle(2.0)
        sdk.modes.pressed = True
        sdk.idle(2.0)
        assert arm.state().by_hand
        sdk.idle(2.0)
        sdk.modes.pressed = False
        sdk.idle(2.0)
        assert arm.state().fault is None


@pytest.mark.parametrize("model", MODELS)
def test_every_other_reading_that_decides_is_of_now(model: str) -> None:
    sdk = sdk_of(model)
    driver = driver_of(sdk, model)
    driver.reading()

    def after_a_pause(then: Callable[[], object]) -> None:
        sdk.idle(1.0)
        then()
        sdk.idle(1.0)

    after_a_pause(lambda: sdk.modes.be("Reflex"))
    driver.recover()
    assert ("automatic_error_recovery", None) in sdk.calls, "the recovery saw the reflex"

    after_a_pause(lambda: sdk.modes.be("UserStopped"))
    with pytest.raises(Failure, match="stop button is pressed") as raised:
        driver.prepare(sdk.now_s)
    assert raised.value.kind == UNMOVED
    assert not any(name == "set_load" for name, _ in sdk.calls)
    driver.carry(SETTINGS.payload)
    assert not any(name == "set_load" for name, _ in sdk.calls), "an arm that is stopped takes none"

    after_a_pause(lambda: sdk.modes.be("Idle"))
    assert driver.listen(100).missed == 0, "the pause before is no lost state"


def test_a_stall_of_the_computer_makes_no_old_state_look_new() -> None:
    """An SDK that returned its kept states one by one, on a computer that stops for 30 ms after some of them."""
    now_s, stamps = 0.0, [*np.arange(90) / 1000.0]
    stalls = {10: 0.03, 11: 0.03, 40: 0.03}

    class Robot:
        reads = 0

        def read_once(self) -> Any:
            nonlocal now_s
            self.reads += 1
            now_s += stalls.get(self.reads, 2e-5)
            if stamps:
                return _state(stamps.pop(0))
            now_s += 0.001
            return _state(5.0 + now_s)

    states = States(Robot(), lambda: now_s)
    assert states.present().time.to_sec() >= 5.0
    assert len([1 for read in stalls if read - 1 in stalls]) + 1 < WAITED_FOR, "two stalls in a row are not enough"


def test_states_that_never_come_as_slowly_as_they_were_sent_are_said() -> None:
    stamps = iter(np.arange(10_000) / 1000.0)

    class Robot:
        def read_once(self) -> Any:
            return _state(float(next(stamps)))

    with pytest.raises(Failure, match="none is known to be a present one") as raised:
        States(Robot(), lambda: 0.0).present()
    assert raised.value.kind == LOST


def _state(at_s: float) -> Any:
    sdk = FakeSdk(k=False, now_s=at_s)
    return sdk.Robot("x", "kIgnore")._state()


class Between(InProcess):
    """The player's process between the check of a motion and its beginning; it reads the arm all the time."""

    events: tuple[Callable[[FakeSdk], None], ...] = ()
    sdk: FakeSdk
    watches = True

    def play(self, *arguments: Any, **more: Any) -> PlayOutcome:
        for event in self.events:
            event(self.sdk)
            if self.watches:
                assert self.driver.watch()
        self.events = ()
        return super().play(*arguments, **more)


def press(sdk: FakeSdk) -> None:
    sdk.modes.pressed = True


def release(sdk: FakeSdk) -> None:
    sdk.modes.pressed = False


def guide(sdk: FakeSdk) -> None:
    sdk.modes.guided = True


def let_go(sdk: FakeSdk) -> None:
    sdk.modes.guided = False


def lock(sdk: FakeSdk) -> None:
    sdk.modes.locked = True


def unlock(sdk: FakeSdk) -> None:
    sdk.modes.locked = False


def reflex(sdk: FakeSdk) -> None:
    sdk.modes.reasons = ("joint_reflex",)


def somebody_recovers(sdk: FakeSdk) -> None:
    sdk.modes.reasons = ()


@pytest.mark.long
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    ("events", "words"),
    [
        ((press, release), "the stop button is pressed"),
        ((guide, let_go), "somebody guides the arm by hand"),
        ((lock, unlock), "the joints are locked"),
        ((reflex, somebody_recovers), "joint_reflex"),
    ],
)
def test_a_person_who_acts_and_lets_go_between_check_and_motion_holds_it(
    model: str, events: tuple[Callable[[FakeSdk], None], ...], words: str
) -> None:
    sdk = sdk_of(model)
    with arm_of(sdk, model, player=Between) as arm:
        path = little(arm.state().q_rad)
        player: Any = arm._player
        player.sdk, player.events = sdk, events
        with pytest.raises(ArmFault, match=rf"since the motion was checked: .*{words}.*nothing has moved"):
            arm.execute(path)
        assert not commands(sdk)
        with pytest.raises(ArmFault, match="recover"):
            arm.execute(path)
        arm.recover()
        arm.execute(path)


@pytest.mark.long
@pytest.mark.parametrize("model", MODELS)
def test_a_pause_in_which_nobody_watched_the_button_moves_nothing(model: str) -> None:
    sdk = sdk_of(model)
    with arm_of(sdk, model, player=Between) as arm:
        path = little(arm.state().q_rad)
        player: Any = arm._player
        player.sdk, player.watches = sdk, False
        player.events = (press, release, lambda sdk: sdk.idle(UNWATCHED_S + 0.1))
        with pytest.raises(ArmFault, match=r"nobody read the arm's state for 0\.24 s \(at most 0\.2 s\)"):
            arm.execute(path)
        assert not commands(sdk)
        arm.recover()
        arm.execute(path)


@pytest.mark.long
@pytest.mark.parametrize("model", MODELS)
def test_a_button_pressed_and_released_while_the_motion_starts_holds_too(model: str) -> None:
    """In the first cycle, after the last look at the arm; and as the arm refuses to begin."""
    sdk = sdk_of(model)
    with arm_of(sdk, model) as arm:
        path = little(arm.state().q_rad)
        begin = sdk.robot._begin

        def pressed_in_the_first_cycle() -> None:
            begin()
            sdk.modes.pressed = True

        def refused() -> None:
            sdk.modes.pressed = True
            try:
                begin()
            finally:
                sdk.modes.pressed = False

        for began in (pressed_in_the_first_cycle, refused):
            sdk.robot._begin = began
            before = len(commands(sdk))
            with pytest.raises(ArmFault):
                arm.execute(path)
            sdk.modes.pressed = sdk.modes.moving = False
            held = [q for q, _ in commands(sdk)[before:]]
            assert len(held) <= 1
            assert all(q == path.q_rad[0].tolist() for q in held)
            with pytest.raises(ArmFault, match="recover"):
                arm.execute(path)
            sdk.robot._begin = begin
            arm.recover()
        arm.execute(path)


@pytest.mark.long
def test_of_the_makers_own_socket_the_first_reading_after_a_second_is_of_now(server: Fr3Process) -> None:
    import pylibfranka  # noqa: PLC0415

    driver = Connection("fr3", pylibfranka, drive_fr3, FrankaSettings(server.host), realtime=False)
    driver.reading()
    threading.Event().wait(1.0)
    server.tell("press")
    first, second = driver.reading(), driver.reading()
    assert first.mode == "UserStopped"
    assert 0.0 < second.at_s - first.at_s < 0.05


@pytest.mark.long
def test_a_button_pressed_and_released_between_check_and_motion_holds_over_the_network(server: Fr3Process) -> None:
    with arm_at(server, timing=RELAXED) as arm:
        path = little(arm.state().q_rad)
        player: Any = arm._player
        play = player.play

        def pressed_before(*arguments: Any, **more: Any) -> PlayOutcome:
            player.play = play
            server.tell("press")
            threading.Event().wait(0.1)
            server.tell("release")
            threading.Event().wait(0.3)
            outcome: PlayOutcome = play(*arguments, **more)
            return outcome

        player.play = pressed_before
        with pytest.raises(ArmFault, match="since the motion was checked: the stop button is pressed"):
            arm.execute(path)
        assert not server.received()
        with pytest.raises(ArmFault, match="recover"):
            arm.execute(path)
        arm.recover()
        arm.execute(path)
