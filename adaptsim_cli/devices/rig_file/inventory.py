"""The devices visible from this machine: serial ports and cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

_BOARDS = ("arduino", "teensy", "adafruit", "sparkfun", "ch340", "1a86")
_BALANCES = ("sartorius", "mettler", "ftdi", "prolific")


@dataclass(frozen=True)
class Inventory:
    """The devices that `config init` offers."""

    ports: tuple[str, ...]  # serial ports, under names that survive replugging if there are such
    cameras: tuple[str, ...]  # serial numbers

    @property
    def pedal_port(self) -> str:
        """The port that looks like a microcontroller board; empty: none does."""
        return _like(self.ports, _BOARDS)

    @property
    def balance_port(self) -> str:
        """The port that looks like a balance or its cable; empty: none does."""
        return _like(self.ports, _BALANCES)


def look() -> Inventory:
    """List the ports, and open every camera briefly in a child process. Raises nothing."""
    from hw.camera.probe import probe_k4a

    return Inventory(serial_ports(Path("/dev")), probe_k4a(patience_s=5.0).serials)


def serial_ports(dev: Path) -> tuple[str, ...]:
    """Serial ports of USB devices in `dev`: by their lasting name, else by the system's number."""
    named = sorted((dev / "serial/by-id").glob("*"))
    numbered = [port for kind in ("ttyACM*", "ttyUSB*") for port in sorted(dev.glob(kind))]
    known = {link.resolve() for link in named}
    return tuple(map(str, [*named, *(port for port in numbered if port.resolve() not in known)]))


def _like(ports: tuple[str, ...], words: tuple[str, ...]) -> str:
    return next((port for port in ports if any(word in port.lower() for word in words)), "")
