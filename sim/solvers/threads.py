"""The number of threads with which numpy and torch compute."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

from threadpoolctl import ThreadpoolController


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Compute on one thread: with several, sums are split differently and results depend on the number of cores."""
    import torch  # noqa: PLC0415 - seconds to import, and no session needs it

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Multiply on one thread inside the `with` block: for small matrices, where waiting threads cost more than they
    save.
    """
    with _libraries().limit(limits=1, user_api="blas"):
        yield


@lru_cache
def _libraries() -> ThreadpoolController:
    """Controls of the BLAS libraries that are loaded now, numpy's among them."""
    return ThreadpoolController()
