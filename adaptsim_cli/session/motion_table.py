"""A motion as a table: each cycle has a row with everything that was commanded and measured."""

from __future__ import annotations

import numpy as np

from adaptsim_cli.session.exporting import as_csv
from adaptsim_cli.session.replaying import WholeTrial
from hw.quantities import QUANTITIES


def as_table(trial: WholeTrial) -> bytes:
    """CSV: the time since the motion began, commanded and measured joints, and each quantity that the arm reported."""
    played = trial.stored.execution
    joints = {"q_commanded": played.q_commanded_rad, "q_measured": played.q_measured_rad}
    columns = {"t_s": played.t_s} | {
        f"{name}_{joint + 1}_rad": values[:, joint] for name, values in joints.items() for joint in range(7)
    }
    for quantity in QUANTITIES:
        if quantity.name in played.measured:
            columns |= dict(zip(quantity.labels, played.measured[quantity.name].T, strict=True))
    rows = np.column_stack(list(columns.values())).tolist()
    return as_csv([dict(zip(columns, row, strict=True)) for row in rows]).encode()
