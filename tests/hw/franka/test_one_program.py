"""An arm belongs to one program of a computer, however its address is spelt."""

from __future__ import annotations

import socket

import pytest

from hw.errors import DeviceUnavailable
from hw.franka.player import addresses, sole


@pytest.mark.parametrize(
    ("one", "other"),
    [("172.16.0.2", "172.16.0.02"), ("172.16.0.2", "172.16.2"), ("127.0.0.1", "127.1"), ("127.0.0.1", "localhost")],
)
def test_two_spellings_of_an_address_are_one_arm(one: str, other: str) -> None:
    for first, second in ((one, other), (other, one)):
        alone = sole(first, 0.0)
        with pytest.raises(DeviceUnavailable, match="another program on this computer is connected to the arm"):
            sole(second, 0.0)
        alone.close()
        sole(second, 0.0).close()


def test_two_addresses_are_two_arms() -> None:
    first, second = sole("172.16.0.2", 0.0), sole("172.16.0.3", 0.0)
    first.close()
    second.close()


def test_a_name_with_several_addresses_keeps_all_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    def resolve(host: str, *rest: object, **more: object) -> list[object]:
        known = {"lab": ["172.16.0.9", "::ffff:172.16.0.8"], "172.16.0.8": ["172.16.0.8"]}
        return [(0, 0, 0, "", (address, 0)) for address in known[host]]

    monkeypatch.setattr(socket, "getaddrinfo", resolve)
    assert addresses("lab") == ["172.16.0.8", "172.16.0.9"]
    alone = sole("lab", 0.0)
    with pytest.raises(DeviceUnavailable):
        sole("172.16.0.8", 0.0)
    alone.close()
    sole("172.16.0.8", 0.0).close()


def test_an_address_that_means_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*arguments: object, **more: object) -> object:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", fails)
    with pytest.raises(DeviceUnavailable, match=r"'my-arm' cannot be resolved .*rig file"):
        sole("my-arm")
    monkeypatch.undo()
    with pytest.raises(DeviceUnavailable, match="cannot be resolved"):
        sole("a" * 70 + ".example")
