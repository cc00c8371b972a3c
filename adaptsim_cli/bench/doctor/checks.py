"""The checks of the rig and of the task, in their order: each judges a reading of `readings`."""

from __future__ import annotations

import re
import time
from collections.abc import Collection, Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from adaptsim_cli.bench.calibration_in_use import current_calibration
from adaptsim_cli.bench.devices.known_arm import KnownArm, folder_of
from adaptsim_cli.bench.doctor import computer, readings
from adaptsim_cli.bench.doctor.readings import serial_ports
from adaptsim_cli.bench.doctor.separation import REACH_M, SIDE_M, open_sides, separation_m, tool_reach_m
from adaptsim_cli.bench.doctor.table import (
    DEVICES,
    TASK,
    DoctorCheck,
    Examined,
    Finding,
    Severity,
    add_check,
    advice,
    after,
    described,
    missing,
    ok,
    real,
    skipped,
    with_rig,
)
from adaptsim_cli.bench.rig_file import devices
from adaptsim_cli.bench.rig_file.devices import DeviceKind
from adaptsim_cli.bench.rig_file.reading import gaps
from adaptsim_cli.config import Resolved
from hw.braking import WORST_STOP_S
from hw.collision import BARE_HAND
from hw.franka.identity import TITLES, identify, narrowed, unsure
from hw.franka.realtime import PRIORITY
from hw.franka.starting import SPARE, proposed
from hw.joint_limits import LIMITS
from hw.stopping import worst_stop

CHECKS: dict[str, DoctorCheck] = dict(computer.CHECKS)
"""Every check by its name, in the order of the screen."""

MEASUREMENTS: dict[str, DoctorCheck] = {}
"""Checks that take a minute of the arm: `adaptsim doctor --measure` makes them after the others."""

check = partial(add_check, CHECKS)


@check(DEVICES, "rig file", "adaptsim setup --hw {hw}, or correct the file", real)
def _rig_file(lab: Examined) -> Finding:
    detail = f"{lab.config.rig}: {lab.rig.name}, {lab.rig.arm.model} at {lab.rig.arm.address}"
    if lab.config.rig_is_own:
        return ok(detail)
    return advice(
        f"{detail}. It belongs to the current folder: a person confirms it, and its waivers do not count",
        f"adaptsim config trust --hw {lab.config.hw}, or use your own rig file (docs/guide/current-folder.md)",
    )


@check(DEVICES, "safeguards", when=described)
def _safeguards(lab: Examined) -> Finding:
    """The safeguards that the rig file must state or waive before the arm moves."""
    if open_gaps := gaps(lab.rig, lab.config.task):
        lacking = "; ".join(gap.message for gap in open_gaps)
        return missing(f"{lacking}, and the arm does not move", "; ".join(gap.remedy for gap in open_gaps))
    sentences = [waiver.sentence for waiver in lab.rig.in_force()]
    sentences += [f"{one.safeguard} is not waived any more, since {one.until}" for one in lab.rig.lapsed()]
    if sentences:
        return advice("; ".join(sentences), "state them in the rig file: docs/guide/rig.md")
    return ok("the rig file states all of them")


@check(
    DEVICES,
    "sides",
    "write [person] with side and from_m, and a [[keep_out]] box for every place of a person",
    with_rig,
)
def _sides(lab: Examined) -> Finding:
    """The sides of the arm that no box closes, where a person may stand within its reach."""
    from sim.tasks import get_task

    hardware = get_task(lab.config.task).hardware
    tool_m = 0.0 if hardware is None else np.linalg.norm(lab.rig.tool(lab.config.task).designed(hardware.X_FT)[:3, 3])
    reach_m = REACH_M + max(float(tool_m), tool_reach_m(BARE_HAND))
    open_ = open_sides(lab.rig.boxes(), reach_m)
    if not open_:
        return ok(f"every side is closed by a box beyond {SIDE_M:g} m")
    text = f"no box closes {', '.join(open_)} beyond {SIDE_M:g} m: the arm may reach a person there"
    if lab.rig.person is None or lab.rig.person.side in open_:
        return advice(f"{text}, and the rig file does not keep the arm off the operator's own side")
    apart_m = separation_m(WORST_STOP_S)
    return ok(
        f"the operator's side ({lab.rig.person.side}) is closed from {lab.rig.person.from_m:g} m; {text}. Separation "
        f"distance {apart_m:.2f} m (ISO 13855)"
    )


MEASURE = "adaptsim setup --hw {hw} --from stop"


@check(DEVICES, "stop button", "the next command that moves the arm leads you through the check", with_rig)
def _stop_button(lab: Examined) -> Finding:
    facts = KnownArm(folder_of(lab.resolved.places, lab.rig)).read()
    if lab.rig.waives("stop_button"):
        return advice("its check is waived by the rig file", "check it by hand every day")
    if not facts.stop_button:
        return advice("it was never checked with this computer")
    message = f"stopped the arm on {facts.stop_button} ({facts.stop_button_by})"
    if facts.stop_button_is_due(datetime.now(UTC)):
        return advice(f"{message}: more than a day ago")
    if facts.stop is not None and not facts.stop.is_within:
        return missing(
            f"{message}; {facts.stop}", f"have the arm's brakes looked at; {MEASURE}".format(**vars(lab.config))
        )
    measured = f"; {facts.stop}" if facts.stop else f"; its stop was never measured: {MEASURE}"
    return ok(message + measured.format(**vars(lab.config)))


MOST_RTT_MS = 0.5
"""Half of a 1 ms cycle; the maker's ping test asks for a time of the same order."""
MOST_MISSED, LONGEST_GAP_S = 0.05, 0.02
"""Limits for an arm's states: libfranka needs 95 % of the commands in time, and twenty lost in a row stop the arm."""
LEAST_FRAMES, STREAM_S = 10, 0.5


@check(DEVICES, "network", "one cable, no switch, no USB adapter; sudo ethtool --set-eee DEVICE eee off", with_rig)
def _network(lab: Examined) -> Finding:
    """Round trips to the arm: time, jitter, losses."""
    address = lab.rig.arm.address
    times_ms, lost, problem = readings.round_trips(address)
    if not times_ms:
        fix = "check that the arm is on, the cable in its control box, and this machine's address in the same network"
        return missing(f"{address} does not answer: {problem}", f"{fix}: ping {address}")
    worst, usual = max(times_ms), median(times_ms)
    message = f"{address} answers in {usual:.2f} ms, {worst:.2f} ms at worst"
    if lost or worst > MOST_RTT_MS:
        return advice(f"{message}, {lost} of {len(times_ms) + lost} lost; recommended: {MOST_RTT_MS:g} ms, 0 lost")
    return ok(message)


@check(DEVICES, "arm", "unlock the joints and activate FCI in Desk; docs/guide/arms.md", after("network"))
def _arm(lab: Examined) -> Finding:
    """The arm's state over FCI, without a motion, and whether a second of states came without a gap."""
    reading, rhythm, notes = readings.arm(lab.rig.arm.model, lab.rig.arm.settings())
    served = "" if rhythm.interface is None else f", interface {rhythm.interface}"
    joints = " ".join(f"{q:.2f}" for q in reading.q_rad)
    message = (
        f"{lab.rig.arm.model} answers over FCI{served}, mode {reading.mode}, joints {joints} rad, external torques of "
        f"up to {max(map(abs, reading.external_Nm)):.1f} Nm at rest; the player runs at real-time priority "
        f"{rhythm.priority}; {rhythm.states} states at 1 kHz, "
        f"{rhythm.missed} missed, longest gap {1e3 * rhythm.longest_gap_s:.1f} ms"
    )
    if reading.unwilling is not None:
        fix = "follow the message; every command that moves the arm also leads you through it"
        return missing(f"{message}; it would not move: {reading.unwilling}", fix)
    if rhythm.missed > MOST_MISSED * rhythm.states or rhythm.longest_gap_s > LONGEST_GAP_S:
        fix = "use one cable without a switch, a real-time kernel, governor performance, and end other programs"
        return advice(f"{message} (at most {100 * MOST_MISSED:g} % and {1e3 * LONGEST_GAP_S:g} ms)", fix)
    if readings.kernel()[1] and rhythm.priority != PRIORITY:
        fix = "report it with this line: libfranka raised the player's priority and the program did not lower it again"
        return missing(f"{message}; a priority of {PRIORITY} is needed, below the kernel's watchdogs", fix)
    return advice(message, "; ".join(notes)) if notes else ok(message)


@check(DEVICES, "arm model", "write the model of the type plate under [arm] of the rig file", after("arm"))
def _arm_model(lab: Examined) -> Finding:
    """The arm's model according to its own report, and whether its joint limits are those that every check assumes."""
    arm_part = lab.rig.arm
    report = readings.arm_report(arm_part.model, arm_part.settings())
    identity = identify(arm_part.model, report)
    if identity.model not in (None, arm_part.model):
        fix = f'write model = "{identity.model}" under [arm] of the rig file, and say --hw {identity.model}'
        return missing(
            f"the rig file says {arm_part.model}, and it is {TITLES[str(identity.model)]}: {identity.why}", fix
        )
    try:
        _, differences = narrowed(LIMITS[arm_part.model], report.urdf)
    except ValueError as error:
        return missing(f"the arm's own description cannot be read: {error}", "restart the arm")
    if identity.model is None:
        return advice("; ".join((unsure(arm_part.model, identity), *differences)))
    if differences:
        return advice("; ".join(differences), "nothing: the narrower limits apply to every motion")
    of_limits = "are those of the table" if report.urdf else "are not handed out by this SDK: those of the table apply"
    return ok(f"{TITLES[identity.model]}: {identity.why}; its joint limits {of_limits}")


@partial(add_check, MEASUREMENTS)(DEVICES, "starts", "docs/guide/rig.md: [arm.starting]", after("arm model"))
def _starts(lab: Examined) -> Finding:
    """The times that the arm needs before a motion, beside the bounds of the rig file. Its settings are sent; nothing
    moves.
    """
    arm_part = lab.rig.arm
    rehearsal = readings.rehearsal(arm_part.model, arm_part.settings())
    lines, proposals, beyond = [], [], []
    for name, (measured, safe, unit) in rehearsal.bounds().items():
        bound = float(getattr(arm_part.starting, name))
        lines.append(f"{name} {measured:.2g} {unit} of {bound:g}")
        if SPARE * measured <= bound:
            continue
        value = proposed(measured, safe)
        if value is None:
            beyond.append(f"{name} needs more than its safe range up to {safe[1]:g} {unit}")
        else:
            proposals.append(f"{name} = {value:g}")
    message = f"{rehearsal.starts} starts and {rehearsal.rest_s:.0f} s at rest: {', '.join(lines)}"
    if beyond:
        fix = "one cable without a switch, a real-time kernel, and no other program; if it stays, report it"
        return missing(f"{message}; {'; '.join(beyond)}", fix)
    if proposals:
        return advice(message, f"write under [arm.starting] of the rig file: {', '.join(proposals)}")
    return ok(message)


WITHDRAWN = "1.1.1"
"""Firmware of the Femto Bolt."""
UPDATE = "install a newer firmware with the maker's viewer, on Windows"


@check(DEVICES, "camera", "see docs/guide/cameras.md", with_rig)
def _camera(lab: Examined) -> Finding:
    part = lab.rig.camera
    report, serial = readings.cameras(part.kind), part.serial
    if report.error is not None:
        return missing(report.error, report.fix or "")
    if serial and serial not in report.serials:
        fix = f'plug it in, or write into [camera] of the rig file: serial = "{report.serials[0]}"'
        return missing(f"{serial} is not plugged in; found: {', '.join(report.serials)}", fix)
    if not serial and len(report.serials) > 1:
        fix = "write the serial number of the one to use into [camera] of the rig file"
        return missing(f"several cameras are plugged in: {', '.join(report.serials)}", fix)
    if not report.depth_engine:
        fix = "install libdepthengine.so.2.0 beside the library; docs/guide/cameras.md"
        return missing(f"{report.library} has no depth engine, so there would be no depth", fix)
    which = next(device for device in report.devices if device.serial == (serial or report.serials[0]))
    message = f"{which.serial}, firmware {which.firmware or '(not reported)'}"
    message += f", {report.maker} library {report.version or '(version unknown)'}"
    if report.maker == "Orbbec" and WITHDRAWN in re.split(r"[ ,]+", which.firmware):
        return missing(f"{message}; its maker withdrew {WITHDRAWN}, whose time stamps overflow", UPDATE)
    return ok(message)


@check(DEVICES, "camera images", "docs/guide/cameras.md: USB, power, display", after("camera"))
def _camera_images(lab: Examined) -> Finding:
    """Half a second of synchronised frames, by the camera's own record."""
    with lab.rig.camera.camera() as camera:
        camera.start_recording()
        time.sleep(STREAM_S)
        camera.stop_recording()
        film = camera.facts().get("recording") or {}
    frames, dropped = int(film.get("frames", 0)), int(film.get("dropped", 0))
    message = f"{frames} synchronised frames in {STREAM_S:.1f} s, {dropped} dropped"
    own = "give it a USB 3 controller and a power supply of its own, and end other programs; docs/guide/cameras.md"
    if frames < LEAST_FRAMES:
        return missing(f"{message}; at least {LEAST_FRAMES} are needed", own)
    return advice(message, own) if dropped else ok(message)


@check(DEVICES, "calibration", "adaptsim calibrate --hw {hw}, ten minutes", described)
def _calibration(lab: Examined) -> Finding:
    calibration, days = current_calibration(lab.config, lab.resolved.places), lab.config.calibration_days
    if calibration is None:
        return missing("this rig has no calibration: the camera pose is unknown")
    u, age = calibration.uncertainty, (datetime.now(UTC) - datetime.fromisoformat(calibration.created)).days
    message, count = f"± {u.sigma_mm:.1f} mm, ± {u.sigma_deg:.2f}°", f"{abs(age)} day{'s' if abs(age) != 1 else ''}"
    if age < 0:
        fix = "timedatectl set-ntp true: the clock of this computer is wrong"
        return advice(f"{message}, made {count} in the future", fix)
    if age >= days:
        fix = f"has the camera moved? adaptsim calibrate check --hw {lab.config.hw}, one minute"
        return advice(f"{message}, {count} old (calibration_days {days})", fix)
    return ok(f"{message}, {count} old")


def _port_problem(lab: Examined, path: str) -> Finding | None:
    """Why a serial port cannot be used; None if it can."""
    may, group = readings.port(Path(path))
    if group is None:
        others = ", ".join(serial_ports(Path("/dev"))) or "none"
        return missing(f"{path} is not there", f"plug it in, or write its port into the rig file; there now: {others}")
    if not may:
        fix = f"sudo usermod -aG {group} $USER, then log in again"
        return missing(f"{path} belongs to the group {group}, and you are not in it", fix)
    return None


def _device(lab: Examined, kind: DeviceKind[Any, Any], part: Any) -> Finding:
    """Whether the device of a part of the rig file answers on its port."""
    if part is None:
        return skipped(kind.without)
    if problem := _port_problem(lab, part.port):
        return problem
    with kind.driver(part) as device:
        return ok(kind.answer(device))


for _name, _kind in devices.DEVICES.items():

    @check(DEVICES, _name, _kind.remedy, with_rig)
    def _serial_device(lab: Examined, name: str = _name, kind: DeviceKind[Any, Any] = _kind) -> Finding:
        return _device(lab, kind, getattr(lab.rig, name))


@check(DEVICES, "instruments", "[devices] of the rig file; docs/guide/add-a-device.md", with_rig)
def _instruments(lab: Examined) -> Finding:
    """Every instrument of the rig file, each read once."""
    if not lab.rig.devices:
        return skipped("the rig file names none")
    answers = []
    for name, part in lab.rig.devices.items():
        kind = devices.OFFERED_INSTRUMENTS.get(name)
        finding = _device(lab, kind, part)
        if finding.verdict is not Severity.OK:
            return missing(f"{name}: {finding.detail}", finding.fix or kind.remedy)
        answers.append(f"{name} {finding.detail}")
    return ok("; ".join(answers))


@check(TASK, "checkpoint", "adaptsim pretrain --task {task}, or leave checkpoint out")
def _checkpoint(lab: Examined) -> Finding:
    from adaptsim_cli.bench.checkpoints import checkpoint_of
    from sim.adaptation.worth_in_words import worth_in_words

    checkpoint = checkpoint_of(lab.config)
    worth = " ".join(worth_in_words(checkpoint.card.worth))
    fits = f"{lab.config.task}/{checkpoint.path.name} fits, sha256 {checkpoint.sha256[:12]}"
    return ok(f"{fits}. {worth}" if worth else fits)


@check(TASK, "world", "adaptsim lab list --task {task}", lambda lab: "" if lab.config.lab_world else "trials need none")
def _world(lab: Examined) -> Finding:
    from sim.lab.world import load_world
    from sim.tasks import get_task

    return ok(f"{load_world(lab.config.lab_world, get_task(lab.config.task)).name} of {lab.config.task}")


@check(TASK, "motion", "[tools], [table], [person] and [[keep_out]] of the rig file", described)
def _motion(lab: Examined) -> Finding:
    """Whether the task is possible in the session's workcell: the middle action at the reference context."""
    from adaptsim_cli.bench.motion import mounted_for, planned

    motion = planned(mounted_for(lab.resolved, None), (), ())
    used = 100 * max(report.worst.ratio for report in motion.reports)
    stop = worst_stop(motion.mounted_task.cell, motion.paths)
    return ok(
        f"{lab.config.task} can be done with this tool and these boxes, {used:.0f} % of the tightest limit; from "
        f"the wish to stop to rest {stop}"
    )


def examine(resolved: Resolved, names: Collection[str] = tuple(CHECKS)) -> Iterator[Finding]:
    """Check everything that an iteration with these settings needs, or only the named checks.

    A missing part is a finding, never an error.
    """
    lab = Examined(resolved)
    every = CHECKS | MEASUREMENTS
    for name in names:
        lab.findings[name] = every[name](lab)
        yield lab.findings[name]
