"""Campaigns: many like cases, of which some run with the long tests and all with the slow ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest


def campaign(cases: Sequence[Any], every: int) -> list[Any]:
    """The cases as parameters: the first of each `every` cases is a long test, the others are slow ones."""
    marks = (pytest.mark.slow if number % every else pytest.mark.long for number in range(len(cases)))
    return [pytest.param(case, marks=mark) for case, mark in zip(cases, marks, strict=True)]
