"""Two simulated FR3s for the tests of a file: one takes seconds to start, and an eighth of a core while it runs.

`place` makes it as new.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from fr3_process import READY_RAD, Fr3Process, fr3


@pytest.fixture(scope="module")
def _patient_fr3() -> Iterator[Fr3Process]:
    with fr3() as running:
        yield running


@pytest.fixture
def server(_patient_fr3: Fr3Process) -> Fr3Process:
    """At the ready pose, at 1 kHz, and it waits for the command of every cycle."""
    _patient_fr3.place(READY_RAD)
    return _patient_fr3


@pytest.fixture(scope="module")
def hurried_fr3() -> Iterator[Fr3Process]:
    """The same wherever it was left, and it goes on as soon as a command came."""
    with fr3(pace="hurried") as running:
        yield running
