"""Pedal and balance on a real serial line: the two ends of a pseudo-terminal."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest
from serial_lines import Box, Line, answering, boxed, plugged_in, until

from hw.errors import BalanceError, DeviceUnavailable
from hw.serial import balance as balances
from hw.serial.balance import SerialBalance, sbi_mass_kg, sics_mass_kg
from hw.serial.enable_pedal import EnablePedal
from hw.serial.pedal_protocol import PERIOD_S, crc8
from hw.watchdog import since_boot_s


@pytest.fixture
def line() -> Iterator[Line]:
    with plugged_in() as made:
        yield made


@pytest.fixture
def box(line: Line) -> Iterator[Box]:
    with boxed(line) as made:
        yield made


def test_hold_to_run(line: Line, box: Box) -> None:
    with EnablePedal(line.port) as pedal:
        assert not pedal.enabled()
        box.pressed = True
        until(pedal.enabled)
        box.pressed = False
        until(lambda: not pedal.enabled())
        assert "released" in pedal.why_not()


def test_silence_stops_and_is_explained(line: Line, box: Box) -> None:
    with EnablePedal(line.port) as pedal:
        box.pressed = True
        until(pedal.enabled)
        box.silent = True
        until(lambda: not pedal.enabled())
        assert "silent" in pedal.why_not()
        box.silent = False
        until(lambda: "again" in pedal.why_not())
        assert not pedal.enabled()


def test_a_computer_that_slept_needs_a_new_press(line: Line, box: Box) -> None:
    """The pedal is held all the time, and its lines go on as if nothing had happened."""
    asleep_s = 0.0
    with EnablePedal(line.port, lambda: since_boot_s() + asleep_s) as pedal:
        box.pressed = True
        until(pedal.enabled)
        asleep_s = 3600.0
        assert not pedal.enabled(), "not even until the next line"
        until(lambda: "again" in pedal.why_not())
        assert not pedal.enabled()


def test_unplugged_while_held(line: Line, box: Box) -> None:
    with EnablePedal(line.port) as pedal:
        box.pressed = True
        until(pedal.enabled)
        box.stop()
        line.unplug()
        until(lambda: not pedal.enabled())
        assert pedal.why_not()


@pytest.mark.long
def test_a_box_that_says_nothing(line: Line) -> None:
    with pytest.raises(DeviceUnavailable, match="not sent"), EnablePedal(line.port):
        pass


def test_a_box_of_another_version(line: Line) -> None:
    body = b"AP7 00001 0 "

    def speak() -> None:
        for _ in range(10):
            os.write(line.device, body + b"%02X\n" % crc8(body))
            threading.Event().wait(PERIOD_S)

    box = threading.Thread(target=speak)
    box.start()
    with pytest.raises(DeviceUnavailable, match="version 7"), EnablePedal(line.port):
        pass
    box.join()


def test_a_port_that_is_not_there() -> None:
    with pytest.raises(DeviceUnavailable, match="opened"), EnablePedal("/dev/no-such-port"):
        pass
    with pytest.raises(DeviceUnavailable, match="opened"), SerialBalance("/dev/no-such-port", "sbi"):
        pass


@pytest.mark.parametrize(
    ("answer", "mass_kg"),
    [(b"+   123.45 g  \r\n", 0.12345), (b"-     1.20 g  \r\n", -0.0012), (b"+   0.3005 kg \r\n", 0.3005)],
)
def test_sbi(answer: bytes, mass_kg: float) -> None:
    assert len(answer) == 16
    assert sbi_mass_kg(answer) == pytest.approx(mass_kg)


@pytest.mark.parametrize(
    ("mass_kg", "answer", "message"),
    [
        (sbi_mass_kg, b"+   123.45    \r\n", "not at rest"),
        (sbi_mass_kg, b"       H      \r\n", "overloaded"),
        (sbi_mass_kg, b"       L      \r\n", "underloaded"),
        (sbi_mass_kg, b"+   123.45 oz \r\n", "'oz'"),
        (sbi_mass_kg, b"+   12x.45 g  \r\n", "instead of a number"),
        (sbi_mass_kg, b"S S 1 g\r\n", "set its interface to SBI with 16 characters"),
        (sics_mass_kg, b"S D     12.3 g\r\n", "not at rest"),
        (sics_mass_kg, b"S I\r\n", "busy"),
        (sics_mass_kg, b"S +\r\n", "overloaded"),
        (sics_mass_kg, b"S -\r\n", "underloaded"),
        (sics_mass_kg, b"ES\r\n", "not MT-SICS"),
        (sics_mass_kg, b"S S     12.3 lb\r\n", "'lb'"),
    ],
)
def test_an_answer_that_is_no_mass(mass_kg: Callable[[bytes], float], answer: bytes, message: str) -> None:
    with pytest.raises(BalanceError, match=message):
        mass_kg(answer)


@pytest.mark.parametrize(
    "value", ["nan", "inf", "-inf", "1_000", "1e3", "-5", "999999", "0x10", "1.2.3", "", ".", "+-1", "\u0663"]
)
@pytest.mark.parametrize("protocol", ["sbi", "mt-sics"])
def test_only_a_plain_number_in_range_is_a_mass(value: str, protocol: str) -> None:
    if protocol == "sbi":
        sign, digits = (value[0], value[1:]) if value[:1] in ("+", "-") else ("+", value)
        answer, mass_kg = f"{sign}{digits:>9} {'kg ':<3}\r\n".encode(), sbi_mass_kg
    else:
        answer, mass_kg = f"S S {value} kg\r\n".encode(), sics_mass_kg
    with pytest.raises(BalanceError, match="the balance"):
        mass_kg(answer)


def test_a_balance_is_asked_and_answers(line: Line) -> None:
    with answering(line, [b"S S     300.12 g\r\n"] * 2) as asked, SerialBalance(line.port, "mt-sics") as balance:
        assert balance.mass_kg() == pytest.approx(0.30012)
    assert asked == [b"S\r\n"] * 2


def test_a_flipped_bit_on_the_line_of_a_balance_is_no_mass(line: Line) -> None:
    """A line of 16 characters has 128 bits, and in 20 cases another mass came out."""
    whole = b"S S     300.12 g\r\n"
    masses_kg = []
    for bit in range(8 * len(whole)):
        spoilt = bytearray(whole)
        spoilt[bit // 8] ^= 1 << (bit % 8)
        if not bytes(spoilt).endswith(b"\n") or spoilt.count(b"\n") != 1:
            continue
        with plugged_in() as ours, answering(ours, [bytes(spoilt), whole]):
            with SerialBalance(ours.port, "mt-sics") as balance, suppress(BalanceError):
                masses_kg.append(balance.mass_kg())
            with suppress(OSError):
                os.write(ours.program, b"S\r\n")  # if the second question was not asked
    assert masses_kg == pytest.approx([0.30012] * len(masses_kg))


def test_a_number_with_a_gap_is_no_mass() -> None:
    with pytest.raises(BalanceError, match="instead of a number"):
        sbi_mass_kg(b"+   1 0.00 g  \r\n")


def test_a_balance_that_does_not_answer(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hw.serial.balance.ANSWER_S", 0.05)
    with SerialBalance(line.port, "sbi") as balance, pytest.raises(DeviceUnavailable, match="answer"):
        balance.mass_kg()


def test_a_balance_that_is_unplugged_is_said_and_found_again(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    with SerialBalance(line.port, "mt-sics") as balance:
        line.unplug()
        for _ in range(2):
            with pytest.raises(BalanceError, match=r"cannot be read .*plug it in again.*weigh again"):
                balance.mass_kg()
        again = Line()
        monkeypatch.setattr(balance, "_port", again.port)  # a pseudo-terminal does not come back under its name
        os.write(again.device, b"S S     999.00 g\r\n")  # of before the question, and not its answer

        def answer() -> None:
            for _ in range(2):
                os.read(again.device, 16)
                os.write(again.device, b"S S     300.12 g\r\n")

        device = threading.Thread(target=answer)
        device.start()
        assert balance.mass_kg() == pytest.approx(0.30012)
        device.join()
        again.unplug()


def test_a_balance_that_takes_no_question_is_said(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(balances, "ASK_S", 0.05)
    with SerialBalance(line.port, "mt-sics") as balance:
        os.set_blocking(line.program, False)
        for _ in range(20):  # until the line stays full, as of a balance that holds its handshake
            with suppress(BlockingIOError):
                while True:
                    os.write(line.program, b"S")
            time.sleep(0.005)  # the kernel may still move some on
        with pytest.raises(BalanceError, match="read"):
            balance.mass_kg()
