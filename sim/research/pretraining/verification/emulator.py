"""Errors of the emulator on rollouts that neither its training nor its calibration used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.errors import DatasetError
from sim.research.pretraining.verification.statistics import wilson
from sim.rollouts.dataset import Dataset
from sim.rollouts.run import Rollouts
from sim.solvers.emulator.network import Emulator
from sim.solvers.emulator.training import EmulatorSettings, held_out_errors, select_rows, split

BINS = 10


@dataclass(frozen=True, eq=False)
class Reliability:
    """Held-out rollouts by the emulator's probability of success, in bins of a tenth."""

    predicted: Array  # (BINS,) mean probability; nan in an empty bin, like the next three
    observed: Array  # (BINS,) share that succeeded
    low: Array  # (BINS,) of its 95 % interval
    high: Array  # (BINS,)
    count: NDArray[np.int_]  # (BINS,)


@dataclass(frozen=True)
class Errors:
    """Errors on some of the held-out rollouts."""

    rollouts: int
    base_rate: float  # accuracy of guessing the commoner outcome
    accuracy: float
    brier: float
    position_median: float  # of the last observed position, in state units (m)
    position_p90: float


@dataclass(frozen=True, eq=False)
class EmulatorHeldOut:
    """The emulator on its held-out rollouts."""

    trained_on: int
    everywhere: Errors  # over the margin, as the dataset
    inside: Errors | None  # only those inside Omega; None if there are none
    calibration_error: float  # expected, ten bins, everywhere
    reliability: Reliability
    position_errors: Array  # (n,) in state units, everywhere


def held_out(
    emulator: Emulator, dataset: Dataset, seed: int, settings: EmulatorSettings, stored: Mapping[str, Any]
) -> EmulatorHeldOut:
    """Judge the emulator again on the rollouts behind its report `stored`.

    Raises DatasetError if the figures differ from the report: then emulator, dataset and report do not belong together.
    """
    task, (_, rows, _) = emulator.task, split(dataset, np.random.default_rng(seed), settings)
    requests, true = select_rows(task, dataset, rows)
    errors = held_out_errors(emulator, requests, true)
    everywhere = _errors(errors, true)
    if abs(everywhere.brier - float(stored["brier"])) > 1e-3:
        raise DatasetError(
            f"on the held-out rollouts the emulator has a Brier score of {everywhere.brier:.4f}, its report says "
            f"{float(stored['brier']):.4f}: dataset, emulator and report do not come from the same pretraining. Remove "
            "emulator.safetensors and what follows, and run the same `adaptsim pretrain` again"
        )
    within = rows[[task.parameters.contains(parameters) for parameters in requests.parameters]]
    inside = None
    if len(within):
        asked, some = select_rows(task, dataset, within)
        inside = _errors(held_out_errors(emulator, asked, some), some)
    said = emulator.predict(requests.parameters, requests.action, requests.nuisance).success
    return EmulatorHeldOut(
        trained_on=int(stored["rollouts"]),
        everywhere=everywhere,
        inside=inside,
        calibration_error=float(stored["calibration_error"]),
        reliability=reliability_bins(said, true.succeeded),
        position_errors=errors["position_error_median"],
    )


def reliability_bins(probability: Array, succeeded: NDArray[np.bool_]) -> Reliability:
    """Predicted against observed successes of (N,) rollouts."""
    bins = np.minimum((probability * BINS).astype(int), BINS - 1)
    count = np.bincount(bins, minlength=BINS)
    n = np.where(count > 0, count, np.nan)
    hits = np.bincount(bins, weights=succeeded, minlength=BINS).astype(int)
    low, high = wilson(hits, count)
    return Reliability(np.bincount(bins, weights=probability, minlength=BINS) / n, hits / n, low, high, count)


def _errors(errors: Mapping[str, Array], true: Rollouts) -> Errors:
    share, apart = float(true.succeeded.mean()), errors["position_error_median"]
    quantiles = np.quantile(apart, [0.5, 0.9]) if len(apart) else (np.nan, np.nan)
    return Errors(
        rollouts=len(true),
        base_rate=max(share, 1.0 - share),
        accuracy=float(errors["accuracy"].mean()),
        brier=float(errors["brier"].mean()),
        position_median=float(quantiles[0]),
        position_p90=float(quantiles[1]),
    )
