"""Explains libfranka's messages about the network and about refused commands: the cause, and the next step.

The sentences are those in the libraries of both SDKs, where `tests/hw/franka/test_explanations.py` reads them. The
causes come from the maker's documentation and from users' reports, with their numbers among libfranka's issues.
"""

from __future__ import annotations

import re
from typing import Literal

from hw.franka import reflexes

Phase = Literal["connecting", "at rest", "starting", "moving"]
CONNECTING: Phase = "connecting"
"""No state of the arm has come yet."""
AT_REST: Phase = "at rest"
STARTING: Phase = "starting"
"""A motion begins: no joint was commanded yet."""
MOVING: Phase = "moving"

_NETWORK = re.compile(r"UDP|TCP|Net Exception|closed connection|Connection|Protocol error|object size", re.IGNORECASE)
_MODE = re.compile(r'not possible in the current mode(?: \("([A-Za-z ]+)"\))?')
_END_OTHERS = "end other programs that use the arm, and tasks in Desk, then run the same command again"
_SAME = "then run the same command again"


def is_network(text: str) -> bool:
    """Whether libfranka's sentence is about its connection."""
    return bool(_NETWORK.search(text))


_UNREACHABLE: tuple[tuple[str, str], ...] = (
    (
        "FCI refused",
        "{who} answers but refuses the connection: unlock the joints and activate FCI in Desk (on a new arm: install "
        "the FCI feature) ({text})",
    ),
    (
        "UDP send|send UDP",
        "this computer could not send to {who} ({text}): its network card is down or has another address; check cable "
        "and card (ip address, ping {host}), " + _SAME,
    ),
    (
        "closed connection|connection got interrupted",
        "{who} closed the connection ({text}): somebody deactivated FCI or locked the joints in Desk, or its control "
        "box restarted; unlock the joints and activate FCI in Desk, " + _SAME,
    ),
    (
        "object size|message size|Protocol error",
        "{who} sent something that the driver does not understand ({text}): check that it is the arm of the rig file "
        "and that no device between changes packets (one cable, no switch); restart the arm, " + _SAME,
    ),
)
"""A pattern of libfranka's sentence -> cause and next step. The first that fits counts."""


def unreachable(who: str, host: str, text: str, phase: Phase) -> str:
    """Why the arm `who` at `host` cannot be reached, by libfranka's sentence."""
    for pattern, words in _UNREACHABLE:
        if re.search(pattern, text):
            return words.format(who=who, host=host, text=text)
    if "UDP receive" in text and phase in (CONNECTING, STARTING):
        return _without_states(who, host, text, phase)
    until = "" if phase is CONNECTING else ", though its states came until then"
    return (
        f"{who} does not answer ({text}){until}: check cable, address and power, unlock the joints and activate FCI in "
        "Desk"
    )


def _without_states(who: str, host: str, text: str, phase: Phase) -> str:
    """The cause if TCP works. Then cable, address and power work too (issues 40, 165, 185, 203, 241), and the states
    are lost on their way.
    """
    if phase is STARTING:
        return (
            f"{who} took the motion, and then none of its states arrived for a second ({text}); no joint was "
            "commanded. Cable and power are good: a switch, a network card that saves energy or a busy computer loses "
            "UDP packets at this moment. Use one cable without a switch, sudo ethtool --set-eee DEVICE eee off, end "
            "other programs"
        )
    return (
        f"{who} answers over TCP, and none of its states arrives over UDP ({text}). Cable, address and power are "
        "good: a firewall drops the states, or a switch or network card drops packets larger than its MTU (a state "
        f"comes in two parts). Let them in (sudo ufw allow proto udp from {host}), use one cable without a switch, set "
        f"the MTU (sudo ip link set DEVICE mtu 1500), {_SAME}"
    )


_BAD_VALUE = (
    "the arm does not take a value that it was sent: compare payload, collision thresholds and impedance in the rig "
    "file with the arm's data sheet, and run the same command again"
)
_REFUSALS = {
    "User Stop pressed": "the stop button was pressed: release it, then recover",
    "activated safety function": (
        "a safety function of the arm is active: open Safety in Desk and end it there. If Desk names a rule that the "
        "arm breaks (a monitored standstill, a reduced speed), somebody with the safety operator's account has to "
        "change that rule; then activate FCI and run the same command again"
    ),
    "manual error recovery required": (
        "the arm does not recover by itself: a joint is outside its range. Unlock the joints in Desk, follow the "
        "recovery of joint limits there, guide the arm to the middle of its range, then recover"
    ),
    "preempted": f"another program or a task in Desk took the arm over: {_END_OTHERS}",
    "start multiple motions": f"the arm makes a motion already, of another program or a task in Desk: {_END_OTHERS}",
    "another control or read operation": (
        "two parts of one program used the arm at once, which this program never does: run one command at a time, and "
        "in a Python program of your own one thread; if it stays, report it"
    ),
    "singular pose": (
        "the arm stands in a singular posture (stretched out, or two joints in one line): guide it by hand to a bent "
        "posture such as its home, then recover and run the same command again"
    ),
    "deviation out of range": _BAD_VALUE,
    "path deviation": (
        "the arm was farther from its path than the motion allows: check what held or pushed it, and compare payload "
        "and impedance in the rig file with the arm; clear the way, then recover"
    ),
    "invalid argument": _BAD_VALUE,
    "invalid input": (
        "the arm does not take a command of the motion and has stopped: recover; if it happens again, keep the "
        "session's record and report it"
    ),
    "still moving": (
        "the motion had ended and the arm still moved: check whether something pulls at it, and compare the payload in "
        "the rig file with the tool; then recover"
    ),
    "Unexpected re": (
        "the arm answered a question that it was not asked: restart the arm's controller in Desk, activate FCI, then "
        "run the same command again"
    ),
    "aborted by reflex": "the arm stopped by itself and names no reason: look at the arm's page in Desk, then recover",
    "command aborted": (
        "the arm ended the motion and names no reason: look at the arm's page in Desk, check the stop button, then "
        "recover"
    ),
}
"""Part of libfranka's sentence -> cause and next step. The first that fits counts."""


def refused(text: str) -> str:
    """libfranka's message for a command that an arm refuses or breaks off, with cause and next step."""
    if (match := _MODE.search(text)) is not None:
        return _in_mode(match[1], text)
    words = next((words for part, words in _REFUSALS.items() if part in text), None)
    return f"the arm says: {text}" if words is None else f"{words} ({text})"


def _in_mode(spoken: str | None, text: str) -> str:
    """The cause if a command for the mode Idle came in another mode; libfranka 0.9 and older do not say in which."""
    if spoken is None:
        return (
            "the arm takes no command now: its stop button is pressed, somebody guides it by hand, its joints are "
            "locked, it stopped by itself, or another program moves it. Release the button, unlock the joints, end the "
            f"other program, then recover ({text})"
        )
    mode = "".join(word.capitalize() for word in spoken.split()) if " " in spoken else spoken
    return reflexes.of_mode(mode, busy=True) or f"the arm says: {text}"
