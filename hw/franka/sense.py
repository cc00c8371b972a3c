"""Checks that an arm's estimate of force is alive; otherwise nothing would stop a tool that presses too hard.

Arms were reported whose estimate of external torques was exactly 0, or stood still. A live estimate shows two things,
even without contact. It has noise in every joint. And its errors (weight, friction, the gears' ripple) depend on the
posture, so its mean differs between two postures by more than its noise explains. An estimate that does not change with
the posture is dead, whatever its value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hw.errors import MotionRefused
from hw.types import Array

LEAST_NOISE_NM = 2e-4
"""Least standard deviation of every joint over the readings: under a hundredth of the noise of a real Panda's quietest
joint, 0.03 Nm."""
APART_RAD, APART_JOINTS = 0.05, 3
"""Least difference of two postures, and least number of joints that differ by it, because the ripple of a single joint
may be equal at both."""
UNLIKELY = 40.0
"""Sum over the joints of the squared change of the mean over its squared standard error. Noise around a constant
exceeds it once in 800,000 times (chi-squared, 7 degrees of freedom); simulated ripple gives hundreds."""
_RESTART = (
    "Without it no contact is felt. Restart the arm's controller in Desk and run the same command again; if it stays "
    "so, the arm needs its maker's service"
)


@dataclass(frozen=True, eq=False)
class _Felt:
    """The estimate at rest in one posture."""

    q_rad: Array  # (7,)
    mean_Nm: Array  # (7,)
    error_Nm: Array  # (7,) standard error of the mean


class ForceSense:
    """The evidence, collected posture by posture, that one arm's estimate of external torques is alive."""

    def __init__(self, model: str) -> None:
        self._model = model
        self._felt: list[_Felt] = []

    def require_alive(self, q_rad: Array, external_Nm: Sequence[Sequence[float]]) -> None:
        """Store the estimate (N, 7) at rest at `q_rad` (7,). Raises MotionRefused if the estimate of a joint does not
        vary.
        """
        values = np.asarray(external_Nm, dtype=np.float64)
        noise_Nm = values.std(axis=0)
        if (noise_Nm < LEAST_NOISE_NM).any():
            joint = int(noise_Nm.argmin())
            raise MotionRefused(
                f"{self._model}: the arm's estimate of external torques is dead: joint {joint + 1} stood at "
                f"{values[0, joint]:.4g} Nm over {len(values)} readings, its spread {1e3 * noise_Nm[joint]:.2g} mNm (a "
                f"live one has at least {1e3 * LEAST_NOISE_NM:g}). Nothing has moved. {_RESTART}"
            )
        self._felt.append(_Felt(np.asarray(q_rad), values.mean(axis=0), noise_Nm / np.sqrt(len(values))))

    def require_change(self) -> None:
        """Compare the newest posture with the latest other one. Raises MotionRefused if the estimate does not differ,
        or if there is none from another posture.
        """
        now = self._felt[-1]
        others = [felt for felt in self._felt if _apart(felt, now)]
        if not others:
            raise MotionRefused(
                f"{self._model}: the arm has felt its load in one posture only, so nothing shows yet that its estimate "
                "of external torques follows it. Nothing has moved. Guide the arm by hand until "
                f"{APART_JOINTS} joints have turned by {np.rad2deg(APART_RAD):.0f}° at least, and run the same command "
                "again"
            )
        change_Nm = np.abs(now.mean_Nm - others[-1].mean_Nm)
        error_Nm = np.hypot(now.error_Nm, others[-1].error_Nm)
        if (ratio := float(np.sum((change_Nm / error_Nm) ** 2))) < UNLIKELY:
            apart_rad = float(np.abs(now.q_rad - others[-1].q_rad).max())
            raise MotionRefused(
                f"{self._model}: the arm's estimate of external torques does not follow the arm: in two postures "
                f"{apart_rad:.2f} rad apart it is the same but for its noise (the joints differ by at most "
                f"{1e3 * change_Nm.max():.2g} mNm, together {ratio:.0f} times their noise, at least {UNLIKELY:.0f}). "
                f"Nothing has moved. {_RESTART}"
            )


def _apart(one: _Felt, other: _Felt) -> bool:
    return bool((np.abs(one.q_rad - other.q_rad) >= APART_RAD).sum() >= APART_JOINTS)
