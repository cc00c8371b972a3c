"""The verdict on a session as a value: the advice, its reason, and the numbers behind it. Other code puts it into
words.
"""

from __future__ import annotations

from enum import StrEnum

from pydantic import Field

from hw.records import Record

LEAST_TRIALS = 6
"""Fewest trials for a verdict. With fewer, it says that there are too few, unless the method makes a forecast."""


class Kind(StrEnum):
    """The advice. The first four come from a forecast, the others from how the parameters move."""

    GO_ON = "go_on"  # no trial has confirmed the policy, and the next iteration tries it
    ENOUGH = "enough"  # two iterations are done, and the last one confirmed its policy
    HOPELESS = "hopeless"  # no action in the ranges is expected to work
    UNINFORMED = "uninformed"  # the predictions made before the trials say nothing about them
    TOO_FEW = "too_few"  # too few trials to judge
    NOT_CONVERGED = "not_converged"
    CONVERGED = "converged"  # the parameters rest at a good reward, or no reward is left to gain
    STAYS_LOW = "stays_low"  # the reward is low, and more iterations do not help
    UNKNOWN = "unknown"  # the word of a newer version

    @property
    def stops(self) -> bool:
        """Whether it says that more trials are not worth their time."""
        return self in (Kind.ENOUGH, Kind.HOPELESS, Kind.UNINFORMED, Kind.CONVERGED, Kind.STAYS_LOW)


class Reason(StrEnum):
    """A further reason for the verdict."""

    INEXPRESSIBLE = "inexpressible"  # no parameters in the ranges predict most trajectories
    FAILURES = "failures"  # many trials in a row earned nothing
    UNTRIED = "untried"  # no trial has confirmed a policy like this one
    FULL = "full"  # every trial of the last iteration earned the most that is possible
    MOVING = "moving"  # the reward is good, but the parameters moved by more than a step in the last iteration


class Verdict(Record):
    """The verdict on a session after an iteration."""

    kind: Kind = Field(description="go on or stop, and by which rule")
    reasons: tuple[Reason, ...] = Field(default=(), description="what else was found")
    reward: float = Field(description="estimated reward of the best policy")
    ci95: tuple[float, float] = Field(description="95 % interval of that reward")
    trials: int = Field(description="trials so far")
    strange: int = Field(description="trajectories that no parameters in the ranges predict")
    gain: float | None = Field(
        default=None, description="expected gain by another iteration, in records of earlier versions; else null"
    )
    likely: float | None = Field(default=None, description="chance of a worthwhile gain; the same")
    prediction_error: float | None = Field(
        default=None, description="root mean square of observed minus predicted rewards, from the second iteration on"
    )
    rank_correlation: float | None = Field(
        default=None, description="Spearman's, of the same rewards; null if all predicted or all observed are alike"
    )

    @property
    def stops(self) -> bool:
        """Whether it says that more trials are not worth their time."""
        return self.kind.stops

    @property
    def has_forecast(self) -> bool:
        """Whether the reward is predicted by the method, not estimated from trials alone."""
        return self.kind in (Kind.GO_ON, Kind.ENOUGH, Kind.HOPELESS, Kind.UNINFORMED)

    @property
    def is_inexpressible(self) -> bool:
        """Whether no parameters in the ranges explain the object."""
        return Reason.INEXPRESSIBLE in self.reasons
