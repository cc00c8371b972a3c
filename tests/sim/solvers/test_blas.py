"""Small matrices are multiplied on one thread, and nothing else is."""

from __future__ import annotations

import numpy as np
from threadpoolctl import threadpool_info, threadpool_limits

from sim.solvers.threads import one_blas_thread


def threads() -> set[int]:
    assert np.eye(3) @ np.eye(3) is not None  # its library is loaded
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_one_thread_inside_and_as_many_as_before_outside() -> None:
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with one_blas_thread():
            assert threads() == {1}
        assert threads() == before
