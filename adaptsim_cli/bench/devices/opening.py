"""The one place that chooses between the simulated lab and a real one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from adaptsim_cli.bench.devices.drivers import Drivers
from adaptsim_cli.bench.devices.lab import Lab
from adaptsim_cli.bench.rig_file.description import RigDescription
from adaptsim_cli.config import Config, places
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from sim.tasks.task import Task


@contextmanager
def open_lab(config: Config, task: Task, drivers: Drivers | None = None, screen: Screen | None = None) -> Iterator[Lab]:
    """The lab of the settings. No device is connected yet; on exit all are disconnected.

    Sessions, calibrations and touch-offs plan with the rig and nominal calibration of the lab. Then they ask it for
    their devices. There is no other way to a device. `drivers` are those of a real lab's devices; None: the
    makers'. `screen` is the command's, where a lab asks its questions; None: a real lab asks them on stderr,
    a simulated one asks nothing. Raises WorldError, UnknownName; for a real lab UsageError (rig file, something neither
    stated nor waived, no terminal; realtime).
    """
    with ExitStack() as stack:
        yield (
            _simulated(config, task, screen, stack)
            if config.is_simulated
            else _real(config, task, drivers, screen, stack)
        )


def check_stop_button(config: Config, rig: RigDescription, screen: Screen, drivers: Drivers | None = None) -> None:
    """Connect only the arm of `rig`. If a check of its stop button is due, have it pressed and released. Nothing moves.

    Raises StoppedByOperator, DeviceUnavailable.
    """
    from adaptsim_cli.bench.devices.drivers import makers_drivers
    from adaptsim_cli.bench.devices.mounted import mounted_as_shipped
    from adaptsim_cli.bench.devices.real import RealLab
    from sim.tasks import get_task

    task = get_task(config.task)
    with ExitStack() as stack:
        lab = RealLab(task, rig, drivers or makers_drivers(), stack, screen, config)
        lab.begin()
        lab.check_stop_button(mounted_as_shipped(task, rig.arm.model).cell)


def _simulated(config: Config, task: Task, screen: Screen | None, stack: ExitStack) -> Lab:
    from adaptsim_cli.bench.devices.simulated import WorldLab
    from adaptsim_cli.bench.rig_file.reading import rig_of, tasks_with_tools
    from sim.lab.world import load_world

    world, rig = load_world(config.world, task), rig_of(config, tasks_with_tools())
    return WorldLab(task, world, config.seed, stack, rig, realtime=config.realtime, pace=config.pace, screen=screen)


def _real(config: Config, task: Task, drivers: Drivers | None, screen: Screen | None, stack: ExitStack) -> Lab:
    if config.realtime:
        raise UsageError(
            f"--realtime slows the simulated lab down, but this is a real arm ({config.hw}). Leave out --realtime, and "
            "remove it from the settings and from ADAPTSIM_REALTIME"
        )
    from adaptsim_cli.bench.devices.drivers import makers_drivers
    from adaptsim_cli.bench.devices.real import RealLab
    from adaptsim_cli.bench.rig_file.claims import rig_claims
    from adaptsim_cli.bench.rig_file.reading import gaps, in_words, rig_of, tasks_with_tools
    from adaptsim_cli.trust import Trust, require

    where = places()
    claims = rig_claims(config, where)
    rig = rig_of(config, tasks_with_tools())
    if open_gaps := gaps(rig, task.name):
        foreign = "" if config.rig_is_own else ". It belongs to the current folder, so its waivers do not count"
        raise UsageError(f"{config.rig}: nothing has moved, because {in_words(open_gaps)}{foreign}")
    asking, trust = screen or Screen(as_json=True), Trust(where.trust_file)
    try:
        console.require_terminal("a real arm moves only when a person at a terminal confirms it; --yes does not")
    except UsageError:
        require(claims, trust, asking, asks=False, command=f"adaptsim config trust --hw {config.hw}")
        raise
    require(claims, trust, asking, asks=True, command=f"adaptsim config trust --hw {config.hw}")
    lab = RealLab(task, rig, drivers or makers_drivers(), stack, asking, config)
    lab.begin()
    return lab
