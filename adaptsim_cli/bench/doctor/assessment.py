"""`adaptsim doctor --assessment`: one sheet about the risks of a rig, with its own numbers, to be completed and signed.

Its order is that of ISO 12100 (limits of the machine, hazards, estimation, reduction) for the tasks that ISO 10218-2
lists for a person at an arm. It is a draft for the lab's own assessment, not a certificate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from itertools import product
from pathlib import Path

import numpy as np

from adaptsim_cli.bench.calibration_in_use import current_calibration
from adaptsim_cli.bench.devices.consent import SLOW_PACE
from adaptsim_cli.bench.devices.known_arm import ArmFacts, KnownArm, SetUp, folder_of, setup_of
from adaptsim_cli.bench.devices.mounted import MountedTask
from adaptsim_cli.bench.doctor.contact_limits import judged
from adaptsim_cli.bench.doctor.separation import (
    INTRUSION_M,
    REACH_M,
    WALKING_M_S,
    SideDistance,
    nearest_m,
    open_sides,
    separation_m,
    tool_reach_m,
)
from adaptsim_cli.bench.motion import mounted_for, planned
from adaptsim_cli.bench.rig_file.description import RigDescription
from adaptsim_cli.bench.rig_file.reading import rig_of, tasks_with_tools
from adaptsim_cli.bench.rig_file.waivers import WITHOUT
from adaptsim_cli.config import Resolved
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.html import fill
from adaptsim_cli.screen.views import top_speed_m_s
from adaptsim_cli.storage import durable
from hw.errors import MotionRefused
from hw.kinematics import forward
from hw.limits import contact_limit_N
from hw.motion_limits import FLANGE
from hw.stopping import REDUCED_M_S, WorstStop, worst_stop
from hw.types import JointPath
from hw.watchdog import SILENCE_S
from sim.errors import NotExecutable

IMPACT_NS_M = 500.0
"""Peak force of an impact per m/s: √(contact stiffness 1e5 N/m, nylon on wood, × effective mass 2.5 kg)."""


@dataclass(frozen=True)
class Motions:
    """The numbers of motions planned with this rig: the task's middle action, and actions at the ends of its ranges."""

    planned: int  # actions; the others cannot be executed
    speed_m_s: float  # of the tool, at most
    stop: WorstStop  # from the wish to stop to rest
    contact_N: float  # predicted, at most
    nearest_m: float | None = None  # the least distance from the person's side; None: there is none

    @property
    def impact_N(self) -> float:
        """Peak force of a rigid contact at the largest speed."""
        return self.speed_m_s * IMPACT_NS_M


def motions_of(mounted_task: MountedTask, actions: Sequence[Sequence[JointPath]], rig: RigDescription) -> Motions:
    """Speeds, stops and forces of the planned paths (in reported joints) of each action."""
    paths = [path for one in actions for path in one]
    arm, X_FT = mounted_task.cell.arm, mounted_task.hardware.X_FT
    return Motions(
        len(actions),
        top_speed_m_s(paths, lambda q_rad: forward(arm.true_rad(q_rad)) @ X_FT),
        worst_stop(mounted_task.cell, paths),
        max((path.contact.force_N for path in paths if path.contact is not None), default=0.0),
        None if rig.person is None else nearest_m(rig.person.box(), mounted_task.cell, paths),
    )


def page(
    mounted_task: MountedTask,
    rig: RigDescription,
    moves: Motions,
    facts: ArmFacts,
    identity: dict[str, str],
    setup: SetUp,
) -> str:
    """The assessment as HTML, three sides of A4; `identity` names rig file, arm and program version."""
    payload, cell = rig.tool(mounted_task.task.name).payload, mounted_task.cell
    accepted, reach_m = worst_stop(cell), REACH_M + tool_reach_m(cell.tool)
    apart_m = separation_m(accepted.time_s)
    regions = judged(rig.arm.model, moves.speed_m_s, rig.arm.stops_at_N, cell.tool.mass, mounted_task.hardware.edge_m)
    side = None
    if rig.person is not None and moves.nearest_m is not None:
        side = SideDistance(rig.person.from_m, moves.nearest_m, apart_m)
    return fill(
        "bench/doctor/assessment.html.j2",
        rig=rig,
        task=mounted_task.task,
        moves=moves,
        identity=identity,
        payload_kg=None if payload is None else payload.mass_kg,
        boxes=[(box.name, _corner(box.low_m), _corner(box.high_m)) for box in cell.keep_out],
        waived=[waiver.safeguard for waiver in rig.in_force()],
        without=[(one, WITHOUT[one.safeguard]) for one in rig.in_force()],
        reach_m=reach_m,
        open_sides=open_sides(cell.keep_out, reach_m),
        side=side,
        apart_m=apart_m,
        walking_m_s=WALKING_M_S,
        intrusion_m=INTRUSION_M,
        regions=regions,
        failing=list(dict.fromkeys(limit for one in regions for limit in one.broken)),
        edge_mm=1e3 * mounted_task.hardware.edge_m,
        flange_m_s=FLANGE[rig.arm.model].m_s,
        allowed_N=contact_limit_N(rig.arm.stops_at_N),
        moved=facts.slow_motion(setup) or "never",
        stop_button=f"{facts.stop_button} by {facts.stop_button_by}" if facts.stop_button else "never",
        measured=str(facts.stop) if facts.stop else "never: adaptsim setup --hw " + rig.arm.model + " --from stop",
        accepted=accepted,
        silence_s=SILENCE_S,
        slow_pace=SLOW_PACE,
        reduced_m_s=REDUCED_M_S,
    )


def _corner(p_m: np.ndarray) -> str:
    return ", ".join(f"{value:.2f}" for value in p_m)


def planned_actions(mounted_task: MountedTask) -> list[Sequence[JointPath]]:
    """The middle action, which must be executable, and the executable actions at the ends of all ranges."""
    plans: list[Sequence[JointPath]] = [planned(mounted_task, (), ()).paths]
    space = mounted_task.task.action
    for ends in product(*zip(space.low.tolist(), space.high.tolist(), strict=True)):
        typed = [f"{name}={value!r}" for name, value in zip(space.names, ends, strict=True)]
        try:
            plans.append(planned(mounted_task, (), typed).paths)
        except (NotExecutable, MotionRefused):
            continue
    return plans


def write(resolved: Resolved, path: Path, screen: Screen) -> None:
    """Plan the task's actions with this rig and write the page. Nothing moves, and no device is opened.

    Raises UsageError (no real arm, no rig file, an existing file), and the errors of planning.
    """
    if resolved.config.is_simulated:
        raise UsageError("--assessment: the simulated lab hurts nobody; name an arm with --hw")
    if path.exists():
        raise UsageError(f"{path} exists already: name a new file")
    config, places = resolved.config, resolved.places
    rig, mounted_task = rig_of(config, tasks_with_tools()), mounted_for(resolved, None)
    calibrated = current_calibration(config, places)
    X_BC = None if calibrated is None else calibrated.hand_eye().X_BC
    setup = setup_of(rig, mounted_task.cell, mounted_task.task.name, X_BC)
    identity = {
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "program": f"adaptsim {metadata.version('adaptsim')}",
        "set-up": " ".join((setup.kind, setup.tool[:8], setup.calibration[:8], setup.rig[:8])),
        "calibration": "none yet: no box around the camera" if calibrated is None else calibrated.created[:10],
    }
    with screen.busy(f"Planning {mounted_task.task.name} with {rig.name}"):
        moves = motions_of(mounted_task, planned_actions(mounted_task), rig)
    text = page(mounted_task, rig, moves, KnownArm(folder_of(places, rig)).read(), identity, setup)
    durable.write_file(path.absolute(), text.encode())
    screen.plain(f"Written: {path}. Print it, complete it, decide, and sign it")
