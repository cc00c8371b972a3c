"""The time limits of slow tests, and the settings of the user that are hidden from every test.

Every process has one thread, because `make test` has one process per core, and threads that wait for a core keep it
busy.
"""

from __future__ import annotations

import os

import pytest

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # read by NumPy, SciPy and PyTorch as they are imported
    os.environ.setdefault(name, "1")

FOR_TESTS = ("ADAPTSIM_TEST_", "ADAPTSIM_DRILL_", "ADAPTSIM_K4A", "ADAPTSIM_KINECT_", "ADAPTSIM_STAGED_")
"""Variables that lead tests to real devices and recordings begin so."""
SLOW_S = 3600.0


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Slow tests have an hour each, unless they say otherwise."""
    for item in items:
        if item.get_closest_marker("slow") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(SLOW_S))


@pytest.fixture(autouse=True)
def _no_settings_of_the_user(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in os.environ:
        if name.startswith("ADAPTSIM_") and not name.startswith(FOR_TESTS):
            monkeypatch.delenv(name)
