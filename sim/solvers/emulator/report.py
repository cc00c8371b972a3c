"""How an emulator did on rollouts that neither its training nor its calibration has seen."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class EmulatorReport:
    """Held-out figures."""

    rollouts: int  # trained on
    held_out: int
    base_rate: float  # share of successes; it or its complement is the accuracy of a constant guess
    accuracy: float
    brier: float
    calibration_error: float  # expected, ten bins
    position_error_median: float  # last observed position, in state units (m)
    position_error_p90: float
    end_state_error_median: float  # of successes, in units
    temperature: float
    misfit_limit: float
