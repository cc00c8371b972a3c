"""Optional packages that only some methods need."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from importlib.util import find_spec
from io import StringIO

import torch

from sim.errors import ExtraMissing
from sim.solvers.threads import one_thread


def require(method: str, package: str, extra: str) -> None:
    """Raises ExtraMissing, with the line that installs it, unless `package` is installed. Imports nothing."""
    if find_spec(package) is None:
        raise ExtraMissing(
            f"{method} needs the package {package}, which is not installed: install the extra with "
            f"pip install 'adaptsim[{extra}]'"
        )


@contextmanager
def calculating(seed: int) -> Iterator[None]:
    """Inside, torch draws from `seed` and computes on one thread, and the packages print nothing.

    So results are the same on every machine, and torch's generator is unchanged afterwards.
    """
    silent = redirect_stdout(StringIO())  # sbi reports training on stdout, which is for data
    with torch.random.fork_rng(devices=[]), one_thread(), warnings.catch_warnings(), silent:
        warnings.simplefilter("ignore")
        torch.manual_seed(seed)
        yield
