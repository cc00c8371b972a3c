"""How long a test may take, beyond the default of pyproject.toml."""

from __future__ import annotations

import pytest

SLOW_S = 3600.0


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Slow tests have an hour each, unless they say otherwise."""
    for item in items:
        if item.get_closest_marker("slow") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(SLOW_S))
