"""Which tasks work inside a keep-out box. Plans nothing for an arm, so the answer is instant."""

from __future__ import annotations

from adaptsim_cli.devices.rig_file.reading import tasks_with_tools
from hw.collision import KeepOut


def reached(box: KeepOut) -> tuple[str, ...]:
    """For each task whose tool enters the box, in its middle action at the reference place: its name and where."""
    from sim.tasks import get_task

    said: list[str] = []
    for name in tasks_with_tools():
        task = get_task(name)
        middle = task.action.middle
        p_m = task.require_hardware().plan(task.reference_context, middle).X_BT[:, :3, 3]
        inside = p_m[((p_m >= box.low_m) & (p_m <= box.high_m)).all(axis=1)]
        if len(inside):
            (x0, y0, _), (x1, y1, _) = inside.min(axis=0), inside.max(axis=0)
            said.append(f"{name} works there, over x {x0:.2f} to {x1:.2f} m, y {y0:+.2f} to {y1:+.2f} m")
    return tuple(said)
