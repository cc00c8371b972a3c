"""A real lab: its devices are connected by the rig file, the arm last and behind its confirmation."""

from __future__ import annotations

import time
from contextlib import ExitStack
from functools import cached_property
from typing import TYPE_CHECKING

from adaptsim_cli.bench.devices.attended import Instruments, Person, PersonBeside, Scales, ToolWatch
from adaptsim_cli.bench.devices.confirmed import ConfirmedArm
from adaptsim_cli.bench.devices.consent import Consent
from adaptsim_cli.bench.devices.drivers import Drivers
from adaptsim_cli.bench.devices.known_arm import KnownArm, StopMeasurement, folder_of, setup_of
from adaptsim_cli.bench.devices.lab import BoardDevices, TouchDevices
from adaptsim_cli.bench.devices.mounted import MountedTask
from adaptsim_cli.bench.devices.pacing import PacedArm
from adaptsim_cli.bench.devices.recovery import offer_recovery
from adaptsim_cli.bench.devices.released import ReleasedHand
from adaptsim_cli.bench.devices.stop_check import StopCheck
from adaptsim_cli.bench.rig import Rig
from adaptsim_cli.bench.rig_file.claims import in_one_sentence
from adaptsim_cli.bench.rig_file.description import RigDescription
from adaptsim_cli.bench.rig_file.devices import OFFERED_INSTRUMENTS
from adaptsim_cli.bench.rig_file.reading import BOARD, gaps, in_words
from adaptsim_cli.config import Config, places
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.log import CommandLog
from adaptsim_cli.screen.release import Each
from adaptsim_cli.storage import durable
from calib.types import HandEye
from hw.collision import KeepOut, camera_box
from hw.ports import Arm, Camera, Hand, Pedal
from hw.types import Array
from hw.workcell import Workcell
from sim.tasks.task import Task

if TYPE_CHECKING:
    from sim.lab.board import HeldBoard


class RealLab:
    """`devices.lab.Lab`: the lab of a rig file, with a person at a terminal."""

    nominal = None

    def __init__(
        self, task: Task, rig: RigDescription, drivers: Drivers, stack: ExitStack, screen: Screen, config: Config
    ) -> None:
        """`screen` is the command's."""
        self.rig, self.title = rig, f"lab {rig.name}, {rig.arm.model} at {rig.arm.address}"
        self._task, self._drivers, self._stack, self._screen = task, drivers, stack, screen
        self._pace, self._operator = config.pace, config.operator
        self._folder, self._rig_file = folder_of(places(), rig), in_one_sentence(config, rig)

    def begin(self) -> None:
        """Show the waivers, and from now on write each line and question of the screen to the log of the arm too."""
        durable.make_folder(self._folder)
        self._screen.add_listener(CommandLog(self._folder, self._screen))
        for waiver in self.rig.in_force():
            self.note(f"Waived: {waiver.sentence}")
        for waiver in self.rig.lapsed():
            self.note(f"Not waived any more: {waiver.safeguard}, since {waiver.until} ({waiver.by}, {waiver.on})")

    def boxes_around_camera(self, X_BC: Array) -> tuple[KeepOut, ...]:
        """The box around the camera."""
        return (camera_box(X_BC),)

    def note(self, message: str) -> None:
        """Show it on the screen."""
        self._screen.note(message)

    def for_trials(self, mounted_task: MountedTask, hand_eye: HandEye, days: int) -> Rig:
        """See `Lab`."""
        self._require_payload(self._task.name)
        watch = self._watch()
        table, X_BC = "nothing on the table but the object", hand_eye.X_BC
        arm = self._arm(mounted_task.cell, self._task.name, table, self._task.name, watch, X_BC)
        camera, scales, instruments = self._camera(infrared=False), self._scales(), self._instruments()
        self._stack.enter_context(arm)
        beside = PersonBeside(arm, camera, mounted_task, self._screen, scales, watch, instruments)
        return Rig(
            name=self.rig.arm.model,
            title=self.title,
            arm=PacedArm[Arm](arm, mounted_task.cell, self._pace),
            camera=camera,
            bench=Person(),
            hand_eye=hand_eye,
            calibration_days=days,
            attendant=beside,
            wait=time.sleep,
            await_enabled=arm.await_enabled,
            more_checks=() if watch is None else (watch.check,),
            pace=self._pace,
            release=arm.release,
        )

    def for_calibration(self, held: HeldBoard, cell: Workcell, home_rad: Array) -> BoardDevices:
        """See `Lab`. The arm stays where it was left."""
        self._require_payload(BOARD)
        arm, camera = self._arm(cell, BOARD, "nothing on the table but the object", BOARD), self._camera(infrared=True)
        self._connect(arm)
        return PacedArm[Arm](arm, cell, self._pace), camera, time.sleep, None, arm.release

    def for_touch_off(self, cell: Workcell) -> TouchDevices:
        """See `Lab`."""
        self._require_payload(self._task.name)
        arm = self._arm(cell, self._task.name, "nothing on the table", "touch-off")
        hand = (
            None if self.rig.without_hand else ReleasedHand(self._hand(), arm.release, arm.await_pedal, arm.hand_moving)
        )
        self._connect(arm)
        return arm, hand, time.sleep, None, arm.release

    def measure_stop(self, mounted_task: MountedTask) -> StopMeasurement:
        """See `Lab`."""
        self._require_payload(self._task.name)
        arm = self._arm(mounted_task.cell, self._task.name, "nothing on the table", "the stop's measurement")
        self._connect(arm)
        check = StopCheck(self._screen, arm, arm, mounted_task.cell, KnownArm(self._folder), arm.release)
        return check.measure(lambda: arm.consent.operator)

    def check_stop_button(self, cell: Workcell) -> None:
        """Connect the arm. If a check of the stop button is due, ask the operator to press and release it. Raises
        StoppedByOperator.
        """
        arm = self._arm(cell, self._task.name, "nothing on the table", "")
        self._stack.enter_context(arm)
        arm.consent.stop_button(arm)

    def _arm(
        self,
        cell: Workcell,
        tool: str,
        on_table: str,
        kind: str,
        watch: ToolWatch | None = None,
        X_BC: Array | None = None,
    ) -> ConfirmedArm:
        """The arm, to be connected last; it does `kind`, with the camera at X_BC (4, 4).

        Its confirmation mentions the object `on_table`; `watch` checks the tool before every motion.
        """
        pedal = self._pedal
        bare = self._drivers.arm(cell, self.rig.arm.settings(self.rig.tool(tool).held()), pedal)
        where = f"{self.rig.arm.model} at {self.rig.arm.address}"
        before = (lambda: None) if watch is None else watch.require
        known_arm = KnownArm(self._folder)
        setup = setup_of(self.rig, cell, kind, X_BC)
        watched = self.rig.waives("slow_start") or bool(known_arm.read().slow_motion(setup))
        each: Each = self.rig.consent if self.rig.consent and watched else "motion"
        consent = Consent(
            self._screen,
            where,
            on_table,
            self._operator,
            pedal is not None,
            self._pace,
            self.rig.in_force(),
            each,
            known_arm,
            setup,
            self._rig_file,
        )
        return ConfirmedArm(bare, consent, pedal, before=before)

    def _require_payload(self, tool: str) -> None:
        """Raises UsageError if the rig file neither states nor waives the weight of this tool."""
        if open_gaps := tuple(gap for gap in gaps(self.rig, tool) if gap.what == "payload"):
            raise UsageError(f"nothing has moved, because of the rig file: {in_words(open_gaps)}")

    @cached_property
    def _pedal(self) -> Pedal | None:
        """The rig's pedal, connected; None if it is waived."""
        part = self.rig.pedal
        if part is None:
            return None
        return self._stack.enter_context(self._drivers.pedal(part))

    def _hand(self) -> Hand:
        """The arm's hand, connected."""
        hand = self._drivers.hand(self.rig.arm.model, self.rig.arm.address, self._pedal)
        return self._stack.enter_context(hand)

    def _watch(self) -> ToolWatch | None:
        """The watch that notices when the hand loses the tool; None if no hand holds it."""
        if self.rig.without_hand:
            return None
        task = self._task.name
        return ToolWatch(self._hand(), f"{task} tool", f"adaptsim touch-off --task {task} --hw {self.rig.arm.model}")

    def _camera(self, *, infrared: bool) -> Camera:
        return self._stack.enter_context(self._drivers.camera(self.rig.camera, infrared))

    def _scales(self) -> Scales | None:
        """The rig's balance; None if it has none."""
        if self.rig.balance is None:
            return None
        return Scales(self._stack.enter_context(self._drivers.balance(self.rig.balance)), self._screen)

    def _instruments(self) -> Instruments:
        """The instruments of the rig file, connected."""
        kinds = {name: OFFERED_INSTRUMENTS.get(name) for name in self.rig.devices}
        drivers = {name: self._stack.enter_context(kinds[name].driver(part)) for name, part in self.rig.devices.items()}
        return Instruments(kinds, drivers, self._screen)

    def _connect(self, arm: ConfirmedArm) -> None:
        """Connect the arm; a fault is cleared once a person types so."""
        self._stack.enter_context(arm)
        offer_recovery(arm, self._screen)
