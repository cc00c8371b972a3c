"""The player's view of an arm's SDK. An SDK's exceptions become a `Failure` of one of four kinds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from hw.franka import explanations, reflexes, versions
from hw.franka.explanations import CONNECTING
from hw.kinematics import JOINTS
from hw.types import frozen_array


@dataclass(frozen=True)
class Reading:
    """The arm at one moment."""

    q_rad: tuple[float, ...]  # (7,) measured
    q_held_rad: tuple[float, ...]  # (7,) held by the arm's controller: the next motion has to begin there
    dq_rad_s: tuple[float, ...]  # (7,)
    mode: str  # libfranka's RobotMode without k: Idle, Move, Reflex, ...
    reasons: tuple[str, ...] = ()  # present reflexes; in mode Reflex, those that ended the last motion
    external_Nm: tuple[float, ...] = (0.0,) * JOINTS  # (7,) the torques of external forces, as the arm estimates them
    at_s: float = 0.0  # the state's stamp, on the arm's clock
    mismatch: str = ""  # how the end effector that is set in Desk differs from the hand; empty: it does not

    def __post_init__(self) -> None:
        """Raises ValueError for a state that is not finite."""
        for name in ("q_rad", "q_held_rad", "dq_rad_s", "external_Nm"):
            frozen_array(getattr(self, name), (JOINTS,), name)

    @property
    def unwilling(self) -> str | None:
        """Why the arm would not move, or None."""
        words = reflexes.of_mode(self.mode)
        return "; ".join(filter(None, (words, reflexes.in_words(self.reasons), self.mismatch))) or None

    @property
    def by_hand(self) -> bool:
        """Whether it refuses to move only while a person guides it, or keeps it stopped."""
        return self.mode in reflexes.BY_HAND and not self.reasons


SdkState = Any
"""Either SDK's RobotState. A cycle reads: q and q_d (held by the controller) in rad, dq in rad/s, tau_ext_hat_filtered
in Nm, (7,) each, and control_command_success_rate, the share of the last 100 commands that arrived in time; also those
of `hw.quantities.QUANTITIES` that it has. At rest
also time, robot_mode, errors, and mass (m_), centre of mass (F_x_C) and inertia (I_) of load and end effector (ee).
"""

Step = Callable[[SdkState, float], tuple[list[float], bool]]
"""One cycle: (state, seconds since the last cycle) -> (joints to command (7,), whether they are the last)."""


FAULT, UNMOVED, LOST, UNAVAILABLE = "fault", "unmoved", "lost", "unavailable"


class Failure(Exception):
    """The kind of a fault of the arm.

    `kind` is FAULT (it stopped or refused), UNMOVED (it takes no motion now), LOST (it does not answer) or UNAVAILABLE
    (cannot connect).
    """

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(kind, text)
        self.kind, self.text = kind, text


def failure(
    error: Exception, model: str, host: str, reasons: tuple[str, ...] = (), phase: explanations.Phase = CONNECTING
) -> Failure:
    """An SDK's exception in words. `reasons` are the reflexes that the arm reports, if it still answers."""
    text = str(error).removeprefix("libfranka: ").strip() or type(error).__name__
    who = f"{model} at {host}"
    mismatch = versions.explain_mismatch(model, text)
    if mismatch:
        return Failure(UNAVAILABLE, f"{who}: {mismatch}")
    if "realtime" in text.lower():
        return Failure(UNAVAILABLE, f"{who}: {text}; see the real-time set-up in docs/guide/arms.md")
    if not reasons and (type(error).__name__ == "NetworkException" or explanations.is_network(text)):
        return Failure(LOST, explanations.unreachable(who, host, text, phase))
    return Failure(FAULT, reflexes.in_words(reasons) or explanations.refused(text))


def mode_name(mode: Any) -> str:
    """RobotMode.Idle of one SDK and RobotMode.kIdle of the other -> Idle."""
    name = str(mode.name)
    return name[1:] if name[:1] == "k" and name[1:2].isupper() else name


def error_names(errors: Any) -> tuple[str, ...]:
    """The reflexes that an SDK's Errors holds."""
    return tuple(n for n in dir(errors) if not n.startswith("_") and getattr(errors, n) is True)
