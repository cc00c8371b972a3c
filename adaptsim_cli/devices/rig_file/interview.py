"""Asks for the parts of a lab. Every question has a default; a wrong answer is explained and asked again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, get_args

from adaptsim_cli.devices.rig_file.description import PersonPart, RigDescription
from adaptsim_cli.devices.rig_file.inventory import Inventory
from adaptsim_cli.devices.rig_file.reached import reached
from adaptsim_cli.devices.rig_file.reading import described
from adaptsim_cli.errors import UsageError
from hw.collision import Side

Ask = Callable[[str, str], str]
"""(question, answer of a plain Enter) -> answer."""

ADDRESS = "172.16.0.2"
"""Default address of an arm's control box."""

ARMS = ("fr3", "panda", "none")
NOTHING = "none"
_SIDES: tuple[Side, ...] = get_args(Side)


def interview(ask: Ask, tell: Callable[[str], None], found: Inventory, arm: str | None) -> RigDescription | None:
    """The lab as answered; None: there is no arm. `arm` answers the first question. Raises StoppedByOperator."""
    model = arm or _one_of(ask, tell, "Which arm is it?", ARMS, ARMS[0])
    if model == NOTHING:
        return None
    rig: dict[str, Any] = {"name": "lab", "arm": {"model": model, "address": ADDRESS}}
    rig |= _checked(ask, tell, "Name of the lab, in one word?", "lab", lambda name: {**rig, "name": name})
    rig |= _checked(
        ask, tell, "At which network address does the arm's control box answer?", ADDRESS,
        lambda address: {**rig, "arm": {"model": model, "address": address}},
    )  # fmt: skip
    if len(found.cameras) != 1:
        tell(f"Cameras seen: {', '.join(found.cameras) or NOTHING}")
    serial = ask("Serial number of the camera (none: any camera that is plugged in)?", (*found.cameras, NOTHING)[0])
    rig["camera"] = {"serial": "" if serial == NOTHING else serial}
    if pedal := _port(ask, tell, "Serial port of the enabling pedal?", found.ports, found.pedal_port):
        rig["pedal"] = {"port": pedal}
    left = tuple(port for port in found.ports if port != pedal)
    balance = found.balance_port if found.balance_port != pedal else ""

    def with_balance(port: str) -> dict[str, Any]:
        return {**rig, "balance": {"port": port}} if port else rig

    port = _port(ask, tell, "Serial port of the balance?", left, balance, lambda port: _tried(with_balance(port)))
    if port:
        protocol = _one_of(ask, tell, "Which protocol does the balance use?", ("mt-sics", "sbi"), "mt-sics")
        rig["balance"] = {"port": port, "protocol": protocol}
    if (side := _side(ask, tell)) != NOTHING:
        rig["person"] = {"side": side}
    return described(rig, "the answers")


def _side(ask: Ask, tell: Callable[[str], None]) -> str:
    """The operator's side; a side that a task needs is explained and asked again."""
    question = "On which side of the arm, seen from its base, does the operator stand?"
    while (side := _one_of(ask, tell, question, (*_SIDES, NOTHING), "left")) != NOTHING:
        person = next(PersonPart(known) for known in _SIDES if known == side)
        if not (said := "; ".join(reached(person.box()))):
            break
        tell(
            f"That side is kept clear from {person.from_m:g} m on, so trials there would be refused: {said}. Give "
            f"another side; or {NOTHING}, and write [person] with a larger from_m into the rig file"
        )
    return side


def _port(
    ask: Ask,
    tell: Callable[[str], None],
    question: str,
    ports: Sequence[str],
    default: str,
    problem: Callable[[str], str] = lambda _: "",
) -> str:
    """A port: a number of the list, a path, or "none", which gives ""."""
    for number, port in enumerate(ports, start=1):
        tell(f"  {number}  {port}")
    numbered = " A number, a path, or none." if ports else " A path, or none."
    while True:
        answer = ask(question + numbered, default or NOTHING)
        if answer.isdigit() and 1 <= int(answer) <= len(ports):
            answer = ports[int(answer) - 1]
        if answer == NOTHING:
            return ""
        said = problem(answer) if answer.startswith("/") else f"{answer!r} is not a path: it begins with /dev/"
        if not said:
            return answer
        tell(said)


def _one_of(ask: Ask, tell: Callable[[str], None], question: str, choices: Sequence[str], default: str) -> str:
    while (answer := ask(f"{question} {', '.join(choices)}.", default).lower()) not in choices:
        tell(f"{answer!r}: choose one of {', '.join(choices)}")
    return answer


def _checked(
    ask: Ask, tell: Callable[[str], None], question: str, default: str, rig_with: Callable[[str], dict[str, Any]]
) -> dict[str, Any]:
    while said := _tried(rig := rig_with(ask(question, default))):
        tell(said)
    return rig


def _tried(rig: dict[str, Any]) -> str:
    """The error in the answers so far; "": none."""
    try:
        described(rig, "")
    except UsageError as error:
        return str(error).removeprefix(": ")
    return ""
