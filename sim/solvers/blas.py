"""The number of threads with which numpy multiplies matrices."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

from threadpoolctl import ThreadpoolController


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Multiply on one thread inside the `with` block: for small matrices, where waiting threads cost more than they
    save.
    """
    with _libraries().limit(limits=1, user_api="blas"):
        yield


@lru_cache
def _libraries() -> ThreadpoolController:
    """Controls of the BLAS libraries that are loaded by now, numpy's among them."""
    return ThreadpoolController()
