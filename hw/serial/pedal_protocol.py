"""The protocol of the enabling pedal, and when it allows motion. Pure: bytes and times in, a verdict out.

The box sends a line every 20 ms (docs/guide/enable-pedal.md):

    AP1 <counter, 5 digits> <0 released | 1 pressed> <CRC-8 of all before it, 2 hex digits>\\n

Motion is allowed while the pedal is held and lines keep coming. It ends on a release, after 60 ms without a valid line,
or if the counter does not continue (the box was unplugged or restarted). Only a new press, seen from its beginning,
allows motion again; a wedged or replugged pedal never does. The pedal is a convenience, not a safety device.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

VERSION = 1
PERIOD_S = 0.020
SILENCE_S = 0.060
MOST_SKIPPED = 3
"""Lines that may be missing between two valid ones: `SILENCE_S` worth of them."""

_COUNTS = 100_000
_LONGEST_LINE = 64


@dataclass(frozen=True)
class PedalLine:
    """One valid line."""

    counter: int
    pressed: bool


@dataclass(frozen=True)
class PedalState:
    """The state of the pedal. `feed` gives the next state; `enabled` is the verdict."""

    last: PedalLine | None = None
    heard_s: float = float("-inf")
    armed: bool = False  # it has been seen released since the last interruption
    held: bool = False  # pressed since then, without interruption
    invalid: int = 0  # lines that were not valid
    other_version: str = ""  # version of a complete line of another version
    unread: bytes = b""  # the start of an incomplete line

    def feed(self, data: bytes, t_s: float) -> PedalState:
        """The state after `data` arrived at `t_s`, on a clock that never goes back."""
        *lines, unread = (self.unread + data).split(b"\n")
        state = self
        for line in lines:
            state = state._after(line, t_s)
        return replace(state, unread=unread[-_LONGEST_LINE:])

    def enabled(self, t_s: float) -> bool:
        """Whether motion is allowed at `t_s`."""
        return self.held and t_s - self.heard_s <= SILENCE_S

    def why_not(self, t_s: float) -> str:
        """The reason for the operator why motion is not allowed."""
        if self.last is None:
            if self.other_version:
                return f"the pedal speaks version {self.other_version}, this program {VERSION}: flash the sketch again"
            return "the pedal has not sent anything"
        if t_s - self.heard_s > SILENCE_S:
            return f"the pedal has been silent for {1000.0 * (t_s - self.heard_s):.0f} ms: check its cable"
        if not self.last.pressed:
            return "the pedal is released"
        return "the pedal has to be released and pressed again"

    def _after(self, line: bytes, t_s: float) -> PedalState:
        message = parse(line)
        if message is None:
            version = version_of(line)
            other = version if version not in ("", str(VERSION)) else self.other_version
            return replace(self, invalid=self.invalid + 1, other_version=other)
        broken = self.last is None or t_s - self.heard_s > SILENCE_S or not _follows(self.last.counter, message.counter)
        armed = (self.armed and not broken) or not message.pressed
        held = message.pressed and armed
        return replace(self, last=message, heard_s=t_s, armed=armed, held=held)


def parse(line: bytes) -> PedalLine | None:
    """A line without its end -> its content; None unless every character is valid."""
    parts = line.split(b" ")
    if len(parts) != 4 or parts[0] != b"AP%d" % VERSION or len(line) != 14:
        return None
    if not parts[1].isdigit() or len(parts[1]) != 5 or parts[2] not in (b"0", b"1"):
        return None
    if parts[3] != b"%02X" % crc8(line[:-2]):
        return None
    return PedalLine(int(parts[1]), parts[2] == b"1")


def version_of(line: bytes) -> str:
    """The version stated by a line with a correct checksum, or ""."""
    if line[:2] != b"AP" or line[-2:] != b"%02X" % crc8(line[:-2]):
        return ""
    return line[2:].split(b" ")[0].decode("ascii", "replace")


def line_for(counter: int, pressed: bool) -> bytes:
    """A line as the box sends it, with its line end."""
    body = b"AP%d %05d %d " % (VERSION, counter % _COUNTS, pressed)
    return body + b"%02X\n" % crc8(body)


def crc8(data: bytes) -> int:
    """CRC-8 with polynomial x⁸ + x² + x + 1, starting at 0 (the SMBus packet error code)."""
    remainder = 0
    for byte in data:
        remainder ^= byte
        for _ in range(8):
            remainder = (remainder << 1) ^ 0x07 if remainder & 0x80 else remainder << 1
        remainder &= 0xFF
    return remainder


def _follows(before: int, now: int) -> bool:
    return 1 <= (now - before) % _COUNTS <= 1 + MOST_SKIPPED
