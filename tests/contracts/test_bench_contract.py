"""What every bench does: the lab's, and a person's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import plain_lab
import pytest

from adaptsim_cli.bench.devices.attended import Person
from hw.ports import ObjectPlacer
from hw.types import Array
from sim.lab.simulated import SimulatedLab

XY_M = np.array([0.68, 0.03])
NEAR_M = 0.02


@dataclass(frozen=True)
class Kind:
    """A bench, and where the object came to lie; None where only a camera could say."""

    bench: ObjectPlacer
    lies_m: Callable[[], Array] | None = None  # (2,) in the base frame


def lab() -> Kind:
    built = SimulatedLab(plain_lab.TASK, plain_lab.world(), 0, plain_lab.CELL)
    return Kind(built.bench, lambda: np.array(built.truth()["trials"][-1]["X_BO_placed"])[:2, 3])


KINDS = {"lab": lab, "person": lambda: Kind(Person())}


@pytest.mark.parametrize("make", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize(("trial", "attempt"), [(0, 0), (-1, 0), (1, -1)])
def test_trials_count_from_1_and_attempts_from_0(make: Callable[[], Kind], trial: int, attempt: int) -> None:
    bench = make().bench
    with pytest.raises(ValueError, match="trials are numbered from 1, attempts from 0"):
        bench.place(XY_M, trial, attempt)
    bench.place(XY_M, 1, 0)


@pytest.mark.parametrize("make", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("xy_m", [np.zeros(3), np.zeros((1, 2)), np.array([np.nan, 0.0])])
def test_a_place_is_two_finite_coordinates(make: Callable[[], Kind], xy_m: Array) -> None:
    with pytest.raises(ValueError, match="xy_m"):
        make().bench.place(xy_m, 1, 0)


@pytest.mark.parametrize("make", KINDS.values(), ids=KINDS)
def test_the_callers_array_stays_the_callers(make: Callable[[], Kind]) -> None:
    kind, xy_m = make(), XY_M.copy()
    kind.bench.place(xy_m, 1, 0)
    np.testing.assert_array_equal(xy_m, XY_M)
    before = None if kind.lies_m is None else kind.lies_m()
    xy_m[:] = 0.0
    if kind.lies_m is not None:
        np.testing.assert_array_equal(kind.lies_m(), before)


def test_the_object_lies_near_and_where_depends_on_trial_and_attempt_alone() -> None:
    def placed(order: list[tuple[int, int]]) -> dict[tuple[int, int], Array]:
        kind, found = lab(), {}
        assert kind.lies_m is not None
        for trial, attempt in order:
            kind.bench.place(XY_M, trial, attempt)
            found[trial, attempt] = kind.lies_m()
        return found

    order = [(1, 0), (1, 1), (2, 0)]
    forwards, backwards = placed(order), placed(order[::-1])
    for key in order:
        assert np.linalg.norm(forwards[key] - XY_M) < NEAR_M
        np.testing.assert_array_equal(forwards[key], backwards[key])
