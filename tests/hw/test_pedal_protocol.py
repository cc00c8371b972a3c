"""The pedal's protocol: what enables, what ends it, and what never enables again by itself."""

from __future__ import annotations

import numpy as np
import pytest

from hw.serial.pedal_protocol import PERIOD_S, SILENCE_S, PedalLine, PedalState, crc8, line_for, parse


def played(*pressed: bool, state: PedalState | None = None, first: int = 0, since_s: float = 0.0) -> PedalState:
    """The state after one line a period."""
    state = state or PedalState()
    for i, held in enumerate(pressed):
        state = state.feed(line_for(first + i, held), since_s + i * PERIOD_S)
    return state


def test_the_checksum_is_the_smbus_one() -> None:
    assert crc8(b"123456789") == 0xF4


def test_a_line_reads_back() -> None:
    assert parse(line_for(99_999, True).rstrip(b"\n")) == PedalLine(99_999, True)


def test_every_single_damaged_byte_is_noticed() -> None:
    good = line_for(1234, False).rstrip(b"\n")
    for i in range(len(good)):
        for value in range(256):
            if value != good[i]:
                assert parse(good[:i] + bytes([value]) + good[i + 1 :]) is None


def test_pressing_after_a_release_enables() -> None:
    state = played(False, True)
    assert state.enabled(PERIOD_S)
    assert not played(False, True, False).enabled(2 * PERIOD_S)


def test_a_pedal_found_pressed_does_not_enable() -> None:
    state = played(True, True, True)
    assert not state.enabled(2 * PERIOD_S)
    assert "released and pressed again" in state.why_not(2 * PERIOD_S)


def test_silence_ends_it_and_its_end_does_not_begin_it_again() -> None:
    state = played(False, True)
    assert state.enabled(PERIOD_S + SILENCE_S)
    assert not state.enabled(PERIOD_S + SILENCE_S + 0.001)
    later = played(True, True, state=state, first=2, since_s=PERIOD_S + SILENCE_S + 0.001)
    assert not later.enabled(PERIOD_S + SILENCE_S + 0.001 + PERIOD_S)


def test_a_restarted_box_does_not_enable() -> None:
    state = played(True, state=played(False, True, first=500), first=0, since_s=2 * PERIOD_S)
    assert not state.enabled(2 * PERIOD_S)


def test_a_frozen_line_is_not_a_sign_of_life() -> None:
    state = played(False, True)
    again = state.feed(line_for(1, True), 2 * PERIOD_S)
    assert not again.enabled(2 * PERIOD_S)


def test_the_counter_goes_round() -> None:
    assert played(False, True, first=99_999).enabled(PERIOD_S)


def test_lines_come_in_any_pieces() -> None:
    stream = b"".join(line_for(i, i > 0) for i in range(3))
    state = PedalState()
    for byte in stream:
        state = state.feed(bytes([byte]), 0.0)
    assert state.enabled(0.0)


def test_garbage_between_lines_is_counted_and_does_no_harm() -> None:
    state = played(False, True).feed(b"\x00\xffgarbage\n" + line_for(2, True), 2 * PERIOD_S)
    assert state.enabled(2 * PERIOD_S)
    assert state.invalid == 1


def test_noise_alone_never_enables() -> None:
    rng = np.random.default_rng(0)
    state = PedalState()
    for i in range(2000):
        state = state.feed(rng.bytes(15) + b"\n", i * PERIOD_S)
        assert not state.enabled(i * PERIOD_S)
    assert len(state.unread) <= 64


def test_another_version_is_named() -> None:
    body = b"AP2 00001 1 "
    state = PedalState().feed(body + b"%02X\n" % crc8(body), 0.0)
    assert "version 2" in state.why_not(0.0)


@pytest.mark.parametrize("line", [b"", b"AP1", b"AP1 1 1 00", b"AP1 00001 2 00", b"AP1 00001 1 zz"])
def test_what_is_not_a_line(line: bytes) -> None:
    assert parse(line) is None
