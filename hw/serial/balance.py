"""A laboratory balance on its serial port: the mass of the object."""

from __future__ import annotations

import re
import termios
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Self

import serial

from hw.errors import BalanceError, DeviceUnavailable
from hw.plugins import Registry

ANSWER_S = 3.0
"""How long a balance may take to settle."""
ASK_S = 1.0
"""How long the request may take to leave the port."""
_LOST = (OSError, serial.SerialException, termios.error)
"""The errors that pyserial raises for a port that is gone."""

HEAVIEST_KG = 50.0
"""More than any object of a trial weighs."""
EMPTY_KG = 0.005
"""Drift of an empty pan below 0 after it was tared."""
AGREES_KG = 5e-6
"""Two stable answers differ by less than this, a few digits of a good balance, or by `AGREES_SHARE`."""
AGREES_SHARE = 2e-4
_NUMBER = re.compile(r"[+-]?[0-9]{1,9}(\.[0-9]{1,9})?")
_KG = {"kg": 1.0, "g": 1e-3, "mg": 1e-6}


def sbi_mass_kg(answer: bytes) -> float:
    """Sartorius SBI: sign, 9 characters of value, blank, 3 of unit; the unit is missing while the pan still moves.

    Raises BalanceError.
    """
    text = answer.decode("ascii", "replace").rstrip("\r\n")
    if len(text) != 14 or text[0] not in "+- ":
        raise BalanceError(
            f"the balance answered {text!r}, which is not SBI: set its interface to SBI with 16 characters"
        )
    value, unit = text[1:10].strip(), text[11:14].strip()
    if value in ("H", "L"):
        raise BalanceError(f"the balance is {'over' if value == 'H' else 'under'}loaded: take the load off and tare it")
    if not unit:
        raise BalanceError("the balance is not at rest: keep draughts and hands away and weigh again")
    return _kg(text[0].strip() + value, unit)


def sics_mass_kg(answer: bytes) -> float:
    """Mettler Toledo MT-SICS: `S S <value> <unit>` at rest, `S D` moving, `S I` busy, `S +` and `S -` out of range.

    Raises BalanceError.
    """
    text = answer.decode("ascii", "replace").strip()
    parts = text.split()
    status = parts[1] if len(parts) > 1 and parts[0] == "S" else ""
    refusals = {
        "D": "the balance is not at rest: keep draughts and hands away and weigh again",
        "I": "the balance is busy: finish what its display asks for and weigh again",
        "+": "the balance is overloaded: take the load off and tare it",
        "-": "the balance is underloaded: put the pan on and tare it",
    }
    if status in refusals:
        raise BalanceError(refusals[status])
    if status != "S" or len(parts) != 4:
        raise BalanceError(f"the balance answered {text!r}, which is not MT-SICS: set its interface to MT-SICS")
    return _kg(parts[2], parts[3])


def _kg(value: str, unit: str) -> float:
    if unit not in _KG:
        raise BalanceError(f"the balance weighs in {unit!r}: set it to g, kg or mg")
    if _NUMBER.fullmatch(value) is None:
        raise BalanceError(f"the balance answered {value!r} instead of a number: check its display and weigh again")
    mass_kg = float(value) * _KG[unit]
    if not -EMPTY_KG <= mass_kg <= HEAVIEST_KG:
        raise BalanceError(
            f"the balance shows {mass_kg:g} kg, not 0 to {HEAVIEST_KG:g} kg: empty the pan, tare it and weigh again"
        )
    return mass_kg


@dataclass(frozen=True)
class BalanceProtocol:
    """How to ask one make of balance for a stable mass."""

    name: str
    baud: int
    question: bytes
    mass_kg: Callable[[bytes], float]


PROTOCOLS = {
    "sbi": BalanceProtocol("sbi", 1200, b"\x1bP\r\n", sbi_mass_kg),
    "mt-sics": BalanceProtocol("mt-sics", 9600, b"S\r\n", sics_mass_kg),
}


BALANCES = Registry[BalanceProtocol](
    label="balance",
    group="adaptsim.balances",
    attribute="BALANCE",
    ours=PROTOCOLS,
    error=DeviceUnavailable,
    value_type=BalanceProtocol,
)


class SerialBalance:
    """A balance that answers requests for the mass on the pan.

    Its lines have no checksum, and a flipped bit makes another digit: every mass is asked for twice.
    """

    def __init__(self, port: str, protocol: str) -> None:
        """`protocol` is one of `BALANCES`. Raises DeviceUnavailable."""
        self._port, self._protocol = port, BALANCES.get(protocol)
        self._line: serial.Serial | None = None

    def __enter__(self) -> Self:
        """Raises DeviceUnavailable."""
        try:
            self._line = self._opened()
        except _LOST as error:
            raise DeviceUnavailable(
                f"balance: {self._port} cannot be opened ({error}); check cable, name and permission "
                "(on Debian: the group dialout)"
            ) from error
        return self

    def __exit__(self, *exc: object) -> None:
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def mass_kg(self) -> float:
        """The stable mass on the pan, on which two answers agree. After an unplugging, the next call opens the port
        again.

        Raises BalanceError (no stable mass, two masses, or unplugged), DeviceUnavailable (no answer).
        """
        first_kg, second_kg = self._once_kg(), self._once_kg()
        if abs(first_kg - second_kg) > max(AGREES_KG, AGREES_SHARE * abs(second_kg)):
            raise BalanceError(
                f"the balance answered {1e3 * first_kg:g} g and then {1e3 * second_kg:g} g: keep draughts and hands "
                "away, check its cable, and weigh again"
            )
        return second_kg

    def _once_kg(self) -> float:
        if self._line is None:
            raise DeviceUnavailable("the balance is not connected: use it inside a `with` block")
        try:
            if not self._line.is_open:
                self._line = self._opened()
            answer = self._asked(self._line)
        except _LOST as error:
            with suppress(*_LOST):
                self._line.close()
            raise BalanceError(
                f"the balance at {self._port} cannot be read ({error}): plug it in again, switch it on, weigh again"
            ) from error
        if not answer.endswith(b"\n"):
            raise DeviceUnavailable(
                f"the balance at {self._port} did not answer within {ANSWER_S:g} s: check its cable, baud rate "
                f"({self._protocol.baud}) and protocol ({self._protocol.name})"
            )
        return self._protocol.mass_kg(answer)

    def _opened(self) -> serial.Serial:
        return serial.Serial(self._port, self._protocol.baud, timeout=ANSWER_S, write_timeout=ASK_S, exclusive=True)

    def _asked(self, line: serial.Serial) -> bytes:
        line.reset_input_buffer()
        line.write(self._protocol.question)
        return bytes(line.read_until(b"\n"))
