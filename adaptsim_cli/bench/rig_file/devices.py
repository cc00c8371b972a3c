"""Every kind of serial device on a rig, one declaration each.

A kind is a part of the rig file, a driver, a sentence for the doctor and the questions of `setup`; all of these derive
from here. Pedal and balance have sections of their own. Every other kind is an *instrument*: `[devices.NAME]` of the
rig file, and its values are stored with each trial. An instrument is a row of `INSTRUMENTS`, or a package with an entry
point of the group `adaptsim.devices`: the kind's name, and a module with a `DEVICE` (docs/guide/add-a-device.md).
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass as plain_dataclass
from dataclasses import field
from typing import Annotated, Any, Generic, TypeVar

from pydantic import AfterValidator, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from adaptsim_cli.bench.rig_file.keys import RULES, key
from adaptsim_cli.errors import plain
from hw.errors import BalanceError, DeviceUnavailable
from hw.plugins import Registry
from hw.ports import Balance
from hw.serial.balance import BALANCES, SerialBalance
from hw.serial.enable_pedal import EnablePedal
from hw.serial.pedal_protocol import VERSION

Part = TypeVar("Part")
Driver = TypeVar("Driver", bound=AbstractContextManager[Any])


@plain_dataclass(frozen=True)
class DeviceKind(Generic[Part, Driver]):
    """One kind of device on a serial port."""

    label: str  # its name in a sentence, e.g. "balance"
    part: type[Part]
    """Its section of the rig file: a dataclass with `RULES`, a `port`, and a `key` for each field."""
    driver: Callable[[Part], Driver]
    """Makes the device without connecting it. Entering it connects it, or raises DeviceUnavailable."""
    answer: Callable[[Driver], str]  # one sentence for the doctor; raises DeviceUnavailable
    remedy: str  # of the doctor, if it does not answer
    without: str = "the rig file names none"  # of the doctor
    cables: tuple[str, ...] = ()  # words in the names of its ports
    choices: Mapping[str, Callable[[], Sequence[str]]] = field(default_factory=dict)
    """The further questions of `setup`: key -> the answers to choose from."""
    measure: Callable[[Driver], Mapping[str, float]] | None = None
    """The values of an instrument, with the unit in the name: stored with each trial. Raises DeviceUnavailable."""


def _one_of(names: Callable[[], Sequence[str]]) -> AfterValidator:
    def listed_name(name: str) -> str:
        if name not in names():
            raise ValueError(f"it must be one of {', '.join(names())}")
        return name

    return AfterValidator(listed_name)


@dataclass(frozen=True, config=RULES)
class PedalPart:
    """The enabling pedal (docs/guide/enable-pedal.md): the arm moves while it is held. Not a safety device."""

    port: Annotated[str, key("serial port", min_length=1, examples=["/dev/ttyACM0"])]


def _pedal_answer(pedal: EnablePedal) -> str:
    return f"answers, protocol version {VERSION}; {'held' if pedal.enabled() else pedal.why_not()}"


PEDAL = DeviceKind(
    label="enabling pedal",
    part=PedalPart,
    driver=lambda part: EnablePedal(part.port),
    answer=_pedal_answer,
    remedy="docs/guide/enable-pedal.md: cable, board, sketch",
    cables=("arduino", "teensy", "adafruit", "sparkfun", "ch340", "1a86"),
)


@dataclass(frozen=True, config=RULES)
class BalancePart:
    """The balance that weighs the object; left out: its mass is not recorded."""

    port: Annotated[str, key("serial port", min_length=1, examples=["/dev/ttyUSB0"])]
    protocol: Annotated[
        str,
        key("protocol by its name, such as mt-sics (Mettler Toledo) or sbi (Sartorius); `adaptsim setup` lists all"),
        _one_of(BALANCES.names),
    ] = "mt-sics"


def _balance_answer(balance: Balance) -> str:
    try:
        return f"answers, {balance.mass_kg():.4f} kg on it"
    except BalanceError as error:
        return f"answers: {error}"


BALANCE = DeviceKind[BalancePart, Balance](
    label="balance",
    part=BalancePart,
    driver=lambda part: SerialBalance(part.port, part.protocol),
    answer=_balance_answer,
    remedy="switch it on; [balance] protocol in the rig file",
    without="the rig file names none: the object's mass is not recorded",
    cables=("sartorius", "mettler", "ftdi", "prolific"),
    choices={"protocol": BALANCES.names},
)

DEVICES: dict[str, DeviceKind[Any, Any]] = {"pedal": PEDAL, "balance": BALANCE}
"""The devices that a session itself uses, by their section of the rig file."""

INSTRUMENTS: dict[str, DeviceKind[Any, Any]] = {}
"""Our own instruments, by name: another one needs a row here and its driver."""


OFFERED_INSTRUMENTS = Registry[DeviceKind[Any, Any]](
    label="device",
    group="adaptsim.devices",
    attribute="DEVICE",
    ours=INSTRUMENTS,
    error=DeviceUnavailable,
    value_type=DeviceKind,
    complaint=lambda name, kind: "" if kind.measure is not None else "has no `measure`, so it is not an instrument",
)
"""Our instruments, and those of installed packages."""


def instrument_parts(content: Mapping[str, Any]) -> dict[str, Any]:
    """The sections `[devices.NAME]`, each as its kind's part. Raises ValueError naming the first wrong key."""
    parts = dict[str, Any]()
    for name, section in content.items():  # an answer of a setup comes as a table, a rig that is copied as a part
        try:
            kind = OFFERED_INSTRUMENTS.get(name)
        except DeviceUnavailable as error:
            raise ValueError(f"devices.{name}: {error}") from error
        table = section if isinstance(section, dict) else dataclasses.asdict(section)
        try:
            parts[name] = TypeAdapter(kind.part).validate_json(json.dumps(table, default=str), strict=True)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(("devices", name, *map(str, first["loc"])))
            raise ValueError(f"{place}: {plain(first['msg'])}") from error
    return parts
