"""`adaptsim doctor --assessment`: one page about the risks of a rig, with its own numbers, to be signed.

Its order is that of ISO 12100 (limits of the machine, hazards, estimation, reduction) for the tasks that ISO 10218-2
lists for a person at an arm. It is a draft for the lab's own assessment, not a certificate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from adaptsim_cli.config import Resolved
from adaptsim_cli.devices.consent import SLOW_PACE
from adaptsim_cli.devices.known_arm import ArmFacts, KnownArm, folder_of
from adaptsim_cli.devices.mounted import MountedTask
from adaptsim_cli.devices.rig_file.description import RigDescription
from adaptsim_cli.devices.rig_file.reading import rig_of, tasks_with_tools
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.storage import durable
from adaptsim_cli.wiring.motion import mounted_for, planned
from hw.braking import STOP_S, check_braking
from hw.contact import IMPACT_NS_M
from hw.guarding import SPEED_M_S
from hw.kinematics import forward
from hw.limits import contact_limit_N
from hw.types import JointPath


@dataclass(frozen=True)
class Motions:
    """The numbers of the middle action of the task, planned with this rig."""

    speed_m_s: float  # of the tool, at most
    stop_s: float  # longest stop
    stop_m: float  # the tool's travel in `STOP_S` at that speed, at most
    contact_N: float  # predicted, at most


def motions_of(there: MountedTask, paths: Sequence[JointPath]) -> Motions:
    """Speeds, stops and forces of planned `paths` in reported joints."""
    speed_m_s, stop_s = 0.0, 0.0
    X_FT = there.hardware.X_FT
    for path in paths:
        tool_m = (forward(there.cell.arm.true_rad(path.q_rad[::10])) @ X_FT)[:, :3, 3]
        speed_m_s = max(speed_m_s, float(np.linalg.norm(np.diff(tool_m, axis=0), axis=1).max()) * 100.0)
        stop_s = max(stop_s, check_braking(path, there.cell.motion).longest_s)
    contact_N = max((path.contact.force_N for path in paths if path.contact is not None), default=0.0)
    return Motions(speed_m_s, stop_s, speed_m_s * STOP_S, contact_N)


@dataclass(frozen=True)
class Hazard:
    """One row: who is exposed, to what, how bad and how likely before the measures, and what reduces it."""

    task: str
    person: str
    hazard: str
    severity: str  # S1 bruise, S2 injury that heals, S3 lasting injury
    likelihood: str  # rare, possible, likely
    here: str  # measures of the program and of this rig
    lab: str  # what stays with the lab


def hazards(rig: RigDescription, moves: Motions) -> tuple[Hazard, ...]:
    """The rows of the page."""
    stops_N = rig.arm.stops_at_N
    peak_N = moves.speed_m_s * IMPACT_NS_M
    pedal = "the arm moves only while the pedal is held" if rig.pedal else "WAIVED: no enabling pedal"
    box = "a box keeps the arm off that side" if rig.person else "WAIVED: no side of a person is kept clear"
    return (
        Hazard(
            "placing the object, reading the screen",
            "operator at the table",
            f"struck by arm or tool at up to {moves.speed_m_s:.2f} m/s; a rigid contact peaks near {peak_N:.0f} N",
            "S2",
            "possible",
            f"{box}; a question before every motion; {pedal}; a stop within {STOP_S:g} s",
            "nobody within reach while a command runs; eye protection; a fence or scanner if others pass by",
        ),
        Hazard(
            "watching a motion",
            "operator with a hand at the stop button",
            f"the tool travels up to {100.0 * moves.stop_m:.0f} cm after the wish to stop",
            "S2",
            "possible",
            "every path can stop along itself at every moment; checked before it begins",
            "the stop button within reach, checked every day: it is the safety device",
        ),
        Hazard(
            "any motion",
            "operator, bystander",
            f"clamped between arm and table or obstacle; the arm stops by itself at {stops_N:g} N",
            "S3",
            "rare",
            f"keep-out boxes: {', '.join(box.name for box in rig.keep_out) or 'none'}; clearance to table and itself",
            "gaps of 100 mm for hands and 500 mm for bodies around the work area, or guards",
        ),
        Hazard(
            "scooping or pushing",
            "operator",
            f"the tool presses on the table with up to {moves.contact_N:.0f} N",
            "S2",
            "rare",
            "contact only inside the declared window; tool and edge as in the rig file",
            "blunt edges where possible; a cover over the tool outside of trials",
        ),
        Hazard(
            "touch-off, tool change",
            "operator with a hand at the gripper",
            f"fingers clamped by the hand; arm at up to {1e3 * SPEED_M_S:g} mm/s",
            "S1",
            "possible",
            f"fingers at 30 mm/s; a typed word; {pedal}" if "hand" not in rig.waived else "WAIVED: no hand is watched",
            "offer the tool by its handle; never reach between the fingers",
        ),
        Hazard(
            "a fault: tool lost, object thrown, reflex, power cut",
            "operator, bystander",
            "a tool or an object flies off; the arm rests on what it touched",
            "S2",
            "rare",
            "the hand is asked before every motion whether it holds the tool; after a fault nothing moves without "
            "`recover`",
            "eye protection; look at the arm first; a way to free a clamped person without power",
        ),
        Hazard(
            "a changed rig file, tool or calibration",
            "operator",
            "the arm moves elsewhere than expected",
            "S2",
            "possible",
            "WAIVED: no slow first motion"
            if "slow_start" in rig.waived
            else f"the first motion runs at pace {SLOW_PACE:g} at most, unless the operator takes it on by name",
            "watch the first motion with a hand at the stop button",
        ),
    )


def page(there: MountedTask, rig: RigDescription, moves: Motions, known: ArmFacts) -> str:
    """The assessment as Markdown, ready to print and sign."""
    payload = rig.tool(there.task.name).payload
    boxes = [f"| {box.name} | {_corner(box.low_m)} | {_corner(box.high_m)} |" for box in there.cell.keep_out]
    rows = [
        f"| {n} | {h.task} | {h.person} | {h.hazard} | {h.severity} | {h.likelihood} | {h.here} | {h.lab} |"
        for n, h in enumerate(hazards(rig, moves), start=1)
    ]
    lines = [
        f"# Risk assessment: {rig.name}, {rig.arm.model} at {rig.arm.address}, {there.task.name}",
        "",
        f"Written by `adaptsim doctor --assessment` on {datetime.now(UTC):%Y-%m-%d}. A draft after ISO 12100 and ISO "
        "10218-2: the lab completes, decides and signs it. No part of this program is a safety device.",
        "",
        "## Limits of the machine",
        "",
        f"* largest speed of the tool in a planned {there.task.name} motion: {moves.speed_m_s:.2f} m/s",
        f"* longest stop of that motion: {moves.stop_s:.2f} s; promised for every motion: {STOP_S:g} s, so at most "
        f"{100.0 * moves.stop_m:.0f} cm of travel",
        f"* the arm stops by itself at {rig.arm.stops_at_N:g} N and at "
        f"{', '.join(f'{torque:g}' for torque in rig.arm.stops_at_Nm)} Nm in joints 1 to 7",
        f"* predicted contact force: {moves.contact_N:.0f} N; allowed: {contact_limit_N(rig.arm.stops_at_N):.0f} N",
        f"* payload in the hand: {'not stated' if payload is None else f'{payload.mass_kg:g} kg'}",
        f"* stop button last found to stop the arm: {known.stop_button or 'never'} {known.stop_button_by}".rstrip(),
        f"* waived by the rig file: {', '.join(rig.waived) or 'nothing'}",
        "",
        "| kept clear | from x, y, z in m | to |",
        "|---|---|---|",
        *(boxes or ["| nothing | | |"]),
        "",
        "## Hazards",
        "",
        "Severity: S1 bruise, S2 injury that heals, S3 lasting injury; likelihood before the measures.",
        "",
        "| | task | person | hazard | severity | likelihood | reduced here by | stays with the lab |",
        "|---|---|---|---|---|---|---|---|",
        *rows,
        "",
        "## Decision",
        "",
        "Remaining risk acceptable: yes / no. Further measures:",
        "",
        "| | name | date | signature |",
        "|---|---|---|---|",
        "| operator | | | |",
        "| safety officer | | | |",
    ]
    return "\n".join(lines) + "\n"


def _corner(p_m: np.ndarray) -> str:
    return ", ".join(f"{value:g}" for value in p_m)


def write(resolved: Resolved, path: Path, screen: Screen) -> None:
    """Plan the task's middle action with this rig and write the page. Nothing moves, and no device is opened.

    Raises UsageError (no real arm, no rig file, an existing file), and the errors of planning.
    """
    if resolved.config.is_simulated:
        raise UsageError("--assessment: the simulated lab hurts nobody; name an arm with --hw")
    if path.exists():
        raise UsageError(f"{path} exists already: name a new file")
    rig, there = rig_of(resolved.config, tasks_with_tools()), mounted_for(resolved, None)
    moves = motions_of(there, planned(there, (), ()).paths)
    text = page(there, rig, moves, KnownArm(folder_of(resolved.places, rig)).read())
    durable.write_file(path.absolute(), text.encode())
    screen.plain(f"Written: {path}. Complete it, decide, and sign it")
