"""The steps that describe the lab: they ask, and fill the rig file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np

from adaptsim_cli.bench.devices.mounted import mounted_as_shipped
from adaptsim_cli.bench.devices.opening import check_stop_button
from adaptsim_cli.bench.doctor import readings
from adaptsim_cli.bench.doctor.readings import like, serial_ports
from adaptsim_cli.bench.rig_file.devices import BALANCE, OFFERED_INSTRUMENTS, PEDAL, DeviceKind
from adaptsim_cli.bench.rig_file.reading import BOARD, tasks_with_tools
from adaptsim_cli.commands.setup_steps.answers import NOTHING, WAIVE, Answers, as_typed, numbers
from adaptsim_cli.errors import UsageError
from hw.camera.kinds import CAMERAS
from hw.collision import KeepOut, Side
from hw.mass import Mass

ANY = "any"
"""The only camera that is plugged in."""


def arm(answers: Answers) -> None:
    """Ask for the lab's name and the arm's address, and show the forces at which the arm stops by itself."""
    arm_part = answers.rig.arm
    answers.take(
        "Name of the lab, in one word?",
        answers.rig.name,
        lambda name: {"name": name},
        "The name appears in records and before each motion. It has no effect on any motion.",
    )
    answers.take(
        "Address of the arm's control box?",
        arm_part.address,
        lambda address: {"arm": {**asdict(arm_part), "address": address}},
        "The IP address at which the arm's web page (Desk) opens in a browser of this computer.",
    )
    torques = as_typed(arm_part.stops_at_Nm.tolist())
    answers.screen.plain(
        f"  The arm stops by itself at {arm_part.stops_at_N:g} N, and at {torques} Nm in joints 1 to 7."
    )
    answers.screen.plain("  Other limits: [arm.collision] of the rig file.")


def stop_button(answers: Answers) -> None:
    """The button is pressed and released, and the arm reports both."""
    check_stop_button(answers.config, answers.rig, answers.screen)


def pedal(answers: Answers) -> None:
    """Ports of the pedal, which may be waived, of the balance, and of the instruments."""
    rig, ports = answers.rig, serial_ports(Path("/dev"))
    for number, port in enumerate(ports, start=1):
        answers.screen.plain(f"  {number}  {port}")
    which = "A number, or a path" if ports else "A path"
    port = rig.pedal.port if rig.pedal else like(ports, PEDAL.cables)

    def with_pedal(text: str) -> None:
        if text != WAIVE:
            answers.put(pedal=_port(text, ports), waivers=answers.waivers_but("pedal"))
        elif not answers.waive("pedal", pedal=None):
            raise UsageError("the arm moves only while its pedal is held: name its port")

    if not rig.waives("pedal"):
        answers.ask(
            f"Serial port of the {PEDAL.label}? {which}; {WAIVE}: to go without.", port or "", with_pedal, _PORT
        )
    _device(answers, BALANCE, ports, answers.rig.balance, lambda part: {"balance": part})
    for name in OFFERED_INSTRUMENTS.names():
        _device(
            answers,
            OFFERED_INSTRUMENTS.get(name),
            ports,
            answers.rig.devices.get(name),
            partial(_with_device, answers, name),
        )


def _device(
    answers: Answers,
    kind: DeviceKind[Any, Any],
    ports: Sequence[str],
    entry: Any,
    parts: Callable[[dict[str, Any] | None], dict[str, Any]],
) -> None:
    """Ask for the port of a device, if it has one, and for the other keys of its kind; `parts` puts it into the rig."""
    rig = answers.rig
    used_ports = {part.port for part in (rig.pedal, rig.balance, *rig.devices.values()) if part is not None}
    port = entry.port if entry else like([port for port in ports if port not in used_ports], kind.cables)
    table = {} if entry is None else asdict(entry)
    question = f"Serial port of the {kind.label}? {'A number, or a path' if ports else 'A path'}, or {NOTHING}."

    def with_port(text: str) -> None:
        if (choice := _port(text, ports)) is None:
            table.clear()
        else:
            table.update(choice)
        answers.put(**parts(table or None))

    answers.ask(question, port or NOTHING, with_port, _PORT)
    if not table:
        return
    for key, choices in kind.choices.items():
        default = table.get(key) or kind.part.__pydantic_fields__[key].default
        table[key] = answers.one_of(
            f"Which {key} does it use?", choices(), default, f"The setting of the {kind.label}."
        )
        answers.put(**parts(table))


def _with_device(answers: Answers, name: str, table: dict[str, Any] | None) -> dict[str, Any]:
    others = {other: asdict(part) for other, part in answers.rig.devices.items() if other != name}
    return {"devices": others if table is None else {**others, name: table}}


def _port(text: str, ports: Sequence[str]) -> dict[str, str] | None:
    """A port from a number of the list or a path; None for "none". Raises UsageError."""
    if text == NOTHING:
        return None
    if text.isdigit() and 1 <= int(text) <= len(ports):
        return {"port": ports[int(text) - 1]}
    if not text:
        raise UsageError("there is no default: type a path, it begins with /dev/")
    if not text.startswith("/"):
        raise UsageError(f"{text!r} is not a path: it begins with /dev/")
    return {"port": text}


def camera(answers: Answers) -> None:
    """The kind of the camera, and its serial number."""
    kind = answers.one_of("Which camera is it?", CAMERAS.names(), answers.rig.camera.kind, _CAMERAS)
    answers.put(camera={**asdict(answers.rig.camera), "kind": kind})
    with answers.screen.busy("Looking for cameras"):
        serials = readings.cameras(kind).serials
    answers.screen.plain(f"  Cameras seen: {', '.join(serials) or NOTHING}")
    camera_part = answers.rig.camera
    default = camera_part.serial or (serials[0] if serials else ANY)
    answers.take(
        f"Serial number of the camera? {ANY}: the only one plugged in.",
        default,
        lambda text: {"camera": {**asdict(camera_part), "serial": "" if text == ANY else text}},
        "It is printed on the camera. With it, another camera at this computer can never be taken for this one.",
    )


_PORT = (
    "The lasting name of the cable under /dev/serial/by-id, as listed above; `adaptsim find` shows which cable it is."
)
_CAMERAS = "The kind of the camera decides which library drives it: docs/guide/cameras.md."
_BOX = "One word for the record, e.g. lamp. Two corners follow; neither arm nor tool enters the box between them."
_CORNER = (
    "Three numbers in m from the middle of the arm's foot: x ahead, y to the arm's left (its right is negative), z up "
    "(below the foot's plate is negative)."
)


class _Drawn:
    """The table and the boxes in the browser, beside a motion of the task, while they are typed."""

    def __init__(self, answers: Answers) -> None:
        from adaptsim_cli.bench.motion import planned
        from sim.tasks import get_task

        self._answers = answers
        with answers.screen.busy("Drawing a motion of the task"):
            shipped = mounted_as_shipped(get_task(answers.config.task), answers.rig.arm.model)
            self._page = planned(shipped, (), ()).page()
        answers.screen.plain(f"  Table and boxes are drawn while you type: {self._page.url}")
        self.again()

    def again(self) -> None:
        """Draw the rig as far as it is described."""
        rig = self._answers.rig
        self._page.surround(rig.table.plane(), rig.table.x_m, rig.table.y_m, rig.boxes())


def table(answers: Answers) -> None:
    """The table, the operator's side, and the boxes, drawn while they are typed."""
    answers.screen.plain("  In the arm's base frame: x ahead, y to the left, z up, from the middle of its foot, in m.")
    drawn = None if answers.defaults else _Drawn(answers)
    for key, question, count, explain in (
        (
            "height_m",
            "How high is the table top?",
            1,
            "The height over the plate on which the arm stands, in m. A table top below that plate is negative: -0.02.",
        ),
        (
            "x_m",
            "From where to where is it free, ahead of the arm?",
            2,
            "Two numbers in m from the middle of the arm's foot: the near edge, then the far edge. Ahead is positive.",
        ),
        (
            "y_m",
            "From where to where is it free, to the sides?",
            2,
            "Two numbers in m from the middle of the arm's foot: the right edge, then the left edge. The arm's left is "
            "positive, so the first one is negative.",
        ),
    ):
        table_part = asdict(answers.rig.table)
        default = as_typed(np.atleast_1d(table_part[key]).tolist())

        def changed(
            text: str, key: str = key, count: int = count, table_part: Mapping[str, Any] = table_part
        ) -> dict[str, Any]:
            values = numbers(text, count)
            return {"table": {**table_part, key: values if count > 1 else values[0]}}

        answers.take(question, default, changed, explain)
        if drawn:
            drawn.again()
    _person(answers)
    if drawn:
        drawn.again()
    _boxes(answers, drawn)


def _person(answers: Answers) -> None:
    """Ask which side of the table belongs to the operator; no motion of a task may go there."""
    person_part = answers.rig.person
    if answers.rig.waives("person"):
        return
    while True:
        side = answers.one_of(
            "On which side, seen from the base, do you stand?",
            (*get_args(Side), WAIVE),
            "left" if person_part is None else person_part.side,
            "The arm's left is +y, its right is -y; ahead is +x. Neither arm nor tool enters the operator's side.",
        )
        if side != WAIVE:
            break
        if answers.waive("person", person=None):
            return

    def kept_clear(text: str) -> dict[str, Any]:
        parts = {
            "person": {"side": side, "from_m": numbers(text, 1)[0]},
            "waivers": answers.waivers_but("person"),
        }
        answers.put(**parts)
        if answers.rig.person is not None and (overlap := "; ".join(reached(answers.rig.person.box()))):
            raise UsageError(f"{overlap}: stand further out")
        return parts

    answers.take(
        "How far from the arm's axis does your side begin?",
        f"{person_part.from_m if person_part else 0.6:g}",
        kept_clear,
        "In m, from the axis of joint 1 outwards, always positive. The arm never reaches beyond it.",
    )


def _boxes(answers: Answers, drawn: _Drawn | None) -> None:
    """Ask for one box after another, until the operator has no more."""
    for box in answers.rig.keep_out:
        answers.screen.plain(f"  box {box.name}: {as_typed(box.low_m)} to {as_typed(box.high_m)}")
    while (name := _next_box(answers)) != NOTHING:
        low_m = answers.ask("  Its lower corner, x y z?", "0.5 -0.9 0", partial(numbers, count=3), _CORNER)
        answers.take("  Its upper corner, x y z?", "0.7 -0.7 0.4", partial(_with_box, answers, name, low_m), _CORNER)
        if drawn:
            drawn.again()
        for overlap in reached(answers.rig.keep_out[-1].box()):
            answers.screen.note(f"  {overlap}: name it again to correct it")


def _next_box(answers: Answers) -> str:
    """The name of the next box; none if there are enough. Without any box, the lab has to state the reason."""
    enough = bool(answers.rig.keep_out) or answers.rig.waives("keep_out")
    what = "Name a box that the arm must keep out of: lamp, stand, screen"
    if enough or answers.defaults:
        return answers.text(f"{what} ({NOTHING}: no more).", NOTHING if enough else "lamp", _BOX)
    name = answers.text(f"{what}; {WAIVE}: to go without any.", "", _BOX)
    if name == WAIVE:
        return NOTHING if answers.waive("keep_out") else _next_box(answers)
    if name in ("", NOTHING):
        answers.screen.note("  There is no box yet, and no default: name the nearest thing that the arm could hit")
        return _next_box(answers)
    return name


def _with_box(answers: Answers, name: str, low_m: Sequence[float], text: str) -> dict[str, Any]:
    box = {"name": name, "low_m": low_m, "high_m": numbers(text, 3)}
    others = [asdict(other) for other in answers.rig.keep_out if other.name != name]
    return {"keep_out": [*others, box], "waivers": answers.waivers_but("keep_out")}


def tool(answers: Answers) -> None:
    """Mass and centre of mass of the task's tool."""
    from sim.tasks import get_task

    task = get_task(answers.config.task)
    hardware = task.require_hardware()
    answers.screen.plain("  A mount of your own: [tools] of the rig file. Parts to print: adaptsim parts")
    _payload(answers, task.name, f"the {task.name} tool", hardware.tool_mass.placed(hardware.X_FT))


def board_payload(answers: Answers, mass_F: Mass) -> None:
    """Mass and centre of mass of the calibration board, by default those of `mass_F` in the flange frame."""
    _payload(answers, BOARD, "the board", mass_F)


def _payload(answers: Answers, name: str, what: str, mass_F: Mass) -> None:
    part = answers.rig.tool(name)
    payload = part.payload
    kg, com_m = (mass_F.kg, mass_F.com_m.tolist()) if payload is None else (payload.mass_kg, payload.com_F_m)

    def put(payload: Mapping[str, Any]) -> dict[str, Any]:
        tools = {other: asdict(tool) for other, tool in answers.rig.tools.items()}
        return {"tools": tools | {name: {**asdict(part), "payload": payload}}}

    answers.take(
        f"Mass of {what}, in kg?",
        f"{kg:.3g}",
        lambda text: put({"mass_kg": numbers(text, 1)[0]}),
        "All that hangs from the flange, with its screws and without the hand, on a kitchen scale: 0.35 is 350 g.",
    )
    mass_kg = answers.rig.tool(name).held().mass_kg
    answers.take(
        "Its centre of mass from the flange, x y z in m?",
        " ".join(f"{value:.3f}" for value in com_m),
        lambda text: put({"mass_kg": mass_kg, "com_F_m": numbers(text, 3)}),
        "Three numbers in m in the flange's frame: z points out of the flange, x and y are marked on it. Balance the "
        "tool on an edge to find it.",
    )


def reached(box: KeepOut) -> tuple[str, ...]:
    """The tasks in which the tool would enter the box, and where, for the middle action at the reference place."""
    from sim.tasks import get_task

    sentences: list[str] = []
    for name in tasks_with_tools():
        task = get_task(name)
        middle = task.action.middle
        p_m = task.require_hardware().plan(task.reference_context, middle).X_BT[:, :3, 3]
        inside = p_m[((p_m >= box.low_m) & (p_m <= box.high_m)).all(axis=1)]
        if len(inside):
            (x0, y0, _), (x1, y1, _) = inside.min(axis=0), inside.max(axis=0)
            sentences.append(f"{name} works there, over x {x0:.2f} to {x1:.2f} m, y {y0:+.2f} to {y1:+.2f} m")
    return tuple(sentences)
