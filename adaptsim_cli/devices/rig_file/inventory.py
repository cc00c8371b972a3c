"""Serial ports that are visible from this machine."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

BOARDS = ("arduino", "teensy", "adafruit", "sparkfun", "ch340", "1a86")
"""In the names of microcontroller boards."""
BALANCES = ("sartorius", "mettler", "ftdi", "prolific")
"""In the names of balances and their cables."""


def serial_ports(dev: Path) -> tuple[str, ...]:
    """Serial ports of USB devices in `dev`: by their lasting name, else by the system's number."""
    named = sorted((dev / "serial/by-id").glob("*"))
    numbered = [port for kind in ("ttyACM*", "ttyUSB*") for port in sorted(dev.glob(kind))]
    known = {link.resolve() for link in named}
    return tuple(map(str, [*named, *(port for port in numbered if port.resolve() not in known)]))


def like(ports: Sequence[str], words: Sequence[str]) -> str:
    """The first port with one of the `words` in its name; empty if there is none."""
    return next((port for port in ports if any(word in port.lower() for word in words)), "")
