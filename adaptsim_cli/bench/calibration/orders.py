"""Finds the order of quaternions that fits the views if their keys state another one, and names it in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations

from adaptsim_cli.bench.calibration import detected_views
from calib import files
from calib.errors import CalibrationError
from calib.foreign.sizing import solve_any_size
from calib.records import ViewRecord
from perception.errors import PerceptionError

_MOST = 0.6
"""This share of the views must agree under another order."""
_OTHER = {"quaternion_wxyz": "quaternion_xyzw", "quaternion_xyzw": "quaternion_wxyz"}
_OTHER |= {f"target_{key}": f"target_{other}" for key, other in _OTHER.items()}
_STATED = {"wxyz": "quaternion_xyzw", "xyzw": "quaternion_wxyz"}
"""The other name of the key `quaternion`, by its order in `[poses]` of setup.toml."""


def fitting_order(stored: files.Folder) -> str:
    """A sentence that names the keys to rename so that the views can be solved; "" if renaming does not help."""
    names = dict(_OTHER)
    if stored.setup.poses.quaternion is not None:
        names["quaternion"] = _STATED[stored.setup.poses.quaternion]
    for keys in _choices(stored, names):
        new_names = {key: names[key] for key in keys}
        try:
            views = tuple(replace(view, record=_renamed(view.record, new_names)) for view in stored.views)
            other = replace(stored, views=views)
            looked = detected_views.detect_views(other)
            solution, _ = solve_any_size(looked.views, looked.setup, stored.forward)
        except (CalibrationError, PerceptionError, ValueError):
            continue
        if len(solution.used) >= _MOST * len(stored.views):
            renamed = " and ".join(f"{key} to {name}" for key, name in new_names.items())
            order = " and ".join(
                f"{key} holds w {'first' if name.endswith('wxyz') else 'last'}" for key, name in new_names.items()
            )
            return f"{len(solution.used)} of {len(stored.views)} views agree if {order}: rename {renamed}"
    return ""


def _choices(stored: files.Folder, names: Mapping[str, str]) -> Iterator[tuple[str, ...]]:
    """The sets of stated keys to read in the other order. Large sets come first, because one program writes all in one
    order.
    """
    stated = [key for key in names if any(getattr(view.record, key) is not None for view in stored.views)]
    for count in range(len(stated), 0, -1):
        yield from combinations(stated, count)


def _renamed(record: ViewRecord, names: Mapping[str, str]) -> ViewRecord:
    """The same numbers under the other names. Raises ValueError if they are then not a pose."""
    values = {name: value for name, value in record if value is not None}
    return ViewRecord.model_validate({names.get(name, name): value for name, value in values.items()})
