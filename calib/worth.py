"""The value of each view of a calibration, and of further views like it.

Each view adds its information to the fit: B' C^-1 B, with B the derivative of the view by the unknowns and C its
covariance. Without one view, or with more like it, the sum gives another error at the worst corner of the work volume.
This is the part of the stated error that views can lower; the unobservable part stays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.bundle import Fit
from calib.geometry import cross_matrix
from calib.types import Worth
from hw.types import Array

MORE = 3
_MOST = 12


def worth(fit: Fit, names: Sequence[str], lever_m: Array) -> Worth:
    """The worth of the views of a fit to one camera, called `names`.

    `lever_m` (P, 3) are the work points relative to the camera, in axes of its carrier.

    If a series cannot be solved without some view, that view counts as infinitely helpful.
    """
    information = np.einsum("nip,nij,njq->npq", fit.B, np.linalg.inv(fit.covariance), fit.B)
    R = np.kron(np.eye(2), fit.state.X_AC[0, :3, :3])

    def error(normal: Array) -> float:
        scale = np.sqrt(np.maximum(np.diagonal(normal), 1e-30))
        try:
            inside = np.linalg.inv(normal / np.outer(scale, scale))[:6, :6] / np.outer(scale[:6], scale[:6])
        except np.linalg.LinAlgError:
            return float("inf")
        covariance = R @ inside @ R.T
        jacobian = np.concatenate([-cross_matrix(lever_m), np.broadcast_to(np.eye(3), (len(lever_m), 3, 3))], axis=-1)
        spread = np.einsum("pij,jk,pik->p", jacobian, covariance, jacobian)
        return float(np.sqrt(spread.max())) if (np.diagonal(covariance) > 0.0).all() else float("inf")

    now = error(fit.normal)
    without = [(name, error(fit.normal - view) / now - 1.0) for name, view in zip(names, information, strict=True)]
    without.sort(key=lambda pair: (-pair[1], pair[0]))
    normal, chosen, shares = fit.normal.copy(), list[int](), list[float]()
    for _ in range(_MOST):
        errors = [error(normal + view) for view in information]
        best = int(np.argmin(errors))
        normal = normal + information[best]
        chosen.append(best)
        shares.append(errors[best] / now)
    halved = [count for count, share in enumerate(shares, start=1) if share <= 0.5]
    more = tuple(dict.fromkeys(names[i] for i in chosen[:MORE]))
    return Worth(tuple(without), more, shares[MORE - 1], halved[0] if halved else None)
