"""What every balance does: both protocols on a pseudo-terminal, the fake of other tests, and a real one."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

import numpy as np
import pytest
from real_lab import ToyBalance
from serial_lines import answering, plugged_in

from hw.errors import BalanceError, DeviceUnavailable
from hw.ports import Balance as BalancePort
from hw.serial.balance import SerialBalance

Loads = Sequence[float | None]
Laden = Callable[[Loads], AbstractContextManager[BalancePort]]
"""Loads in kg, one a weighing; None is a pan that still moves -> a balance, not entered."""


def sbi(mass_kg: float | None) -> bytes:
    """Sign, 9 characters of value, blank, 3 of unit."""
    if mass_kg is None:
        return b"+   300.12    \r\n"
    return f"{'-' if mass_kg < 0.0 else '+'}{abs(1e3 * mass_kg):9.2f} g  \r\n".encode()


def sics(mass_kg: float | None) -> bytes:
    return b"S D     300.12 g\r\n" if mass_kg is None else f"S S {1e3 * mass_kg:10.2f} g\r\n".encode()


def on_a_line(protocol: str, said: Callable[[float | None], bytes]) -> Laden:
    @contextmanager
    def laden(loads: Loads) -> Iterator[BalancePort]:
        answers = [said(load) for load in loads for _ in range(1 if load is None else 2)]  # a mass is asked for twice
        with plugged_in() as line, answering(line, answers):
            yield SerialBalance(line.port, protocol)

    return laden


@contextmanager
def toy(loads: Loads) -> Iterator[BalancePort]:
    yield ToyBalance(list(loads))


KINDS: dict[str, Laden] = {"sbi": on_a_line("sbi", sbi), "mt-sics": on_a_line("mt-sics", sics), "toy": toy}


@pytest.fixture(params=KINDS)
def laden(request: pytest.FixtureRequest) -> Laden:
    return KINDS[request.param]


def test_it_must_be_entered(laden: Laden) -> None:
    with laden([]) as balance, pytest.raises(DeviceUnavailable, match="not connected"):
        balance.mass_kg()


def test_left_it_is_unavailable(laden: Laden) -> None:
    with laden([0.3]) as balance:
        with balance as entered:
            assert entered is balance
            balance.mass_kg()
        with pytest.raises(DeviceUnavailable, match="not connected"):
            balance.mass_kg()


def test_it_weighs_in_kilograms(laden: Laden) -> None:
    with laden([0.30012, 0.0, -0.0012]) as balance, balance:
        assert [balance.mass_kg() for _ in range(3)] == pytest.approx([0.30012, 0.0, -0.0012])


def test_a_pan_that_moves_gives_no_mass_and_is_weighed_again(laden: Laden) -> None:
    with laden([None, None, 0.25]) as balance, balance:
        for _ in range(2):
            with pytest.raises(BalanceError, match="not at rest"):
                balance.mass_kg()
        assert balance.mass_kg() == pytest.approx(0.25)


@pytest.mark.hardware
def test_a_real_balance_weighs_its_empty_pan() -> None:
    """Tared, at rest, at ADAPTSIM_TEST_BALANCE=sbi:/dev/ttyUSB0 or mt-sics:/dev/ttyUSB0."""
    protocol, _, port = os.environ.get("ADAPTSIM_TEST_BALANCE", "").partition(":")
    if not port:
        pytest.fail("say where the balance is: ADAPTSIM_TEST_BALANCE=sbi:/dev/ttyUSB0")
    balance = SerialBalance(port, protocol)
    with balance:
        masses_kg = [balance.mass_kg() for _ in range(3)]
    assert np.abs(masses_kg).max() < 1e-3
    with pytest.raises(DeviceUnavailable, match="not connected"):
        balance.mass_kg()
