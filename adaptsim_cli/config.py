"""Settings: flag > ADAPTSIM_* > adaptsim.toml of the project > the user's config > default.

`ADAPTSIM_HOME` moves data and the user's config to one folder.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import platformdirs
from pydantic import Field, PrivateAttr, ValidationError

from adaptsim_cli.errors import UsageError, location, plain, unknown
from hw.bounded import Unreadable, read_table
from hw.records import Record

Hardware = Literal["fake", "panda", "fr3", "fr3v2", "own"]
SIMULATED: Hardware = "fake"
OWN: Hardware = "own"
"""A robot of one's own, which answers questions (docs/guide/own-robot.md)."""
PERSON = "person"

LEARNT = ("emulator", "naf")
"""Solvers that need Phase 1."""
DIRECT = "direct"
"""The solver and the method without Phase 1."""
SOLVERS = (*LEARNT, DIRECT)


def is_simulated(hw: str) -> bool:
    """Whether `hw` names the simulated lab. No other code compares hardware names."""
    return hw == SIMULATED


def is_own(hw: str) -> bool:
    """Whether `hw` means the user's own robot, for which this program opens no device."""
    return hw == OWN


def same_lab(task: str, hw: str, world: str, seed: int | None = None) -> str:
    """The options that lead another command to the same task and lab."""
    seeded = "" if seed is None else f" --seed {seed}"
    return f"--task {task} " + (f"--world {world}{seeded}" if is_simulated(hw) else f"--hw {hw}")


PROJECT_FILE = "adaptsim.toml"
RIG_FILE, PRACTICE_FILE = "rig.toml", "practice.toml"
TRUST_FILE = "trusted.json"
_PREFIX = "ADAPTSIM_"
FLAG = "flag"
"""The origin of a setting from the command line."""
_NOT_SETTINGS = frozenset(
    _PREFIX + name
    for name in (
        "HOME",
        "DEBUG",
        "K4A_LIBRARY",  # hw/camera/k4a_library.py
        *("K4ARECORD_LIBRARY", "KINECT_RECORDING", "STAGED_KINECT", "DRILL_TRANSCRIPT"),  # for tests and benchmarks
        "REPOSITORY_URL",  # setup.py
    )
)
_OF_TESTS = _PREFIX + "TEST_"
"""The variables that lead tests to real devices begin with this."""


class Config(Record):
    """All settings, checked; the description of a key is its help, with its unit."""

    hw: Annotated[
        Hardware, Field(description="hardware: fake, panda, fr3, fr3v2, or own: a robot that answers questions")
    ] = "fake"
    rig: Annotated[str, Field(description="rig file of a real lab; empty: rig.toml beside the settings")] = ""
    task: Annotated[str, Field(description="task of a command without --task: its name, or a Python file")] = "scooping"
    world: Annotated[str, Field(description="world of the simulated lab: a name or a TOML file")] = "wd"
    recorded: Annotated[
        str, Field(description="folder of recorded trials that replace the lab (docs/guide/recorded-trials.md)")
    ] = ""
    answer_with: Annotated[
        str,
        Field(description="with hw = own: command of the program that answers, or person (docs/guide/own-robot.md)"),
    ] = ""
    answer_moves: Annotated[
        Literal["robot", "nothing"],
        Field(
            description="what that program moves: robot (every trial is confirmed) or nothing (counts only as a flag, "
            "or in the file of its answer_with)"
        ),
    ] = "robot"
    answer_limit_s: Annotated[
        float,
        Field(
            gt=0.0,
            le=86400.0,
            allow_inf_nan=False,
            description="silence of the program after which the session asks whether to wait, s",
        ),
    ] = 600.0
    held_out: Annotated[
        float,
        Field(
            ge=0.0, le=0.9, allow_inf_nan=False, description="share of the recorded trials kept for scores, 0 to 0.9"
        ),
    ] = 0.5
    start_from: Annotated[str, Field(description="session whose posterior a new session begins with; empty: none")] = ""
    method: Annotated[str, Field(description="method: adaptsim, random, udr, ...")] = "adaptsim"
    control: Annotated[
        str, Field(description="method or session whose policy makes control trials, e.g. udr; empty: none")
    ] = ""
    pairs: Annotated[
        int,
        Field(
            ge=0,
            le=500,
            description="pairs planned for the comparison with the control; 0: those of a session of five iterations",
        ),
    ] = 0
    checkpoint: Annotated[
        str, Field(description="name or folder of a checkpoint; empty: the shipped one, or that of the own object")
    ] = ""
    solver: Annotated[
        str,
        Field(description="solver of task policies: emulator, naf, or direct without Phase 1; empty: as pretrained"),
    ] = ""
    object: Annotated[
        str, Field(description="TOML file of your object, or the name of a shipped one (docs/guide/own-objects.md)")
    ] = ""
    realtime: Annotated[
        bool, Field(description="the simulated lab moves at the arm's own pace, so that you can watch")
    ] = False
    pace: Annotated[
        float,
        Field(
            ge=0.1, le=1.0, allow_inf_nan=False, description="speed of every motion, 0.1 to 1; below 1 nothing counts"
        ),
    ] = 1.0
    operator: Annotated[str, Field(description="name of the operator, for the record; empty: asked")] = ""
    seed: Annotated[int, Field(ge=0, le=2**32 - 1, description="seed of all random numbers")] = 0
    particles: Annotated[int, Field(ge=1, le=16, description="parameter distributions adapted side by side")] = 2
    workers: Annotated[int, Field(ge=0, le=1024, description="processes for simulations; 0: one per core")] = 0
    min_free_mb: Annotated[int, Field(ge=0, description="free disk space that a session needs, MB")] = 500
    calibration_days: Annotated[
        int, Field(ge=1, description="age at which the program warns about a calibration, days")
    ] = 30
    _own_rigs: frozenset[str] = PrivateAttr(default=frozenset())  # paths of rig files, by `load`

    @property
    def rig_is_own(self) -> bool:
        """Whether the rig file is the user's own: beside the user's settings, or named by those or the environment.

        Any other rig file belongs to the current folder: `adaptsim_cli.trust` asks about it, and its waivers never
        count. Settings that `load` did not make own no rig file.
        """
        return self.rig in self._own_rigs

    @property
    def is_simulated(self) -> bool:
        """Whether everything happens in the simulated lab: no real robot moves."""
        return is_simulated(self.hw)

    @property
    def is_own(self) -> bool:
        """Whether a robot of one's own makes the trials."""
        return is_own(self.hw)

    @property
    def lab_world(self) -> str:
        """The world of the simulated lab; empty for a real arm and for recorded trials."""
        return self.world if self.is_simulated and not self.recorded else ""

    @property
    def target_name(self) -> str:
        """The place of trials as part of a name: the recordings, the world of the simulated lab, or the arm."""
        return Path(self.recorded).name or Path(self.lab_world).stem or self.hw

    @property
    def same_lab(self) -> str:
        """The options that lead another command to the same rig or world."""
        return same_lab(self.task, self.hw, self.world, self.seed)

    @property
    def same_task(self) -> str:
        """The options that lead another command to the same task and object."""
        return f"--task {self.task}" + (f" --object {shlex.quote(self.object)}" if self.object else "")

    def unattended(self, yes: bool) -> bool:
        """Whether no question is asked: with `--yes`, but never with a real arm."""
        return yes and self.is_simulated


@dataclass(frozen=True)
class Places:
    """The folders of data and settings."""

    data: Path
    user_file: Path
    project_file: Path
    trust_file: Path  # the confirmations of `adaptsim_cli.trust`, never inside the current folder

    @property
    def home_is_own(self) -> bool:
        """Whether the settings were made by the user: an ADAPTSIM_HOME inside the current folder may have come with
        that folder.
        """
        return self.trust_file.parent == self.user_file.parent

    @property
    def rig_files(self) -> tuple[Path, Path]:
        """Default places of a rig file, the project's first."""
        return self.project_file.with_name(RIG_FILE), self.user_file.with_name(RIG_FILE)

    @property
    def foreign_settings(self) -> tuple[str, ...]:
        """The settings files that may have come with the current folder, whether they exist or not."""
        return (str(self.project_file), *(() if self.home_is_own else (str(self.user_file),)))

    @property
    def sessions(self) -> Path:
        """The folder of the sessions."""
        return self.data / "sessions"

    @property
    def logs(self) -> Path:
        """The folder of the loggers' logs of sessions."""
        return self.data / "logs"

    @property
    def pretraining(self) -> Path:
        """The folder of own checkpoints."""
        return self.data / "pretraining"

    @property
    def world_tables(self) -> Path:
        """The folder of the world tables for benchmarks."""
        return self.data / "world-tables"

    @property
    def benchmarks(self) -> Path:
        """The folder of the benchmarks' results."""
        return self.data / "benchmarks"

    @property
    def calibrations(self) -> Path:
        """The folder of the calibrations."""
        return self.data / "calibrations"


@dataclass(frozen=True)
class Resolved:
    """Settings with the origin of each."""

    config: Config
    sources: Mapping[str, str]
    places: Places

    @property
    def flags(self) -> frozenset[str]:
        """The settings that were given as flags."""
        return frozenset(key for key, source in self.sources.items() if source == FLAG)


def places(env: Mapping[str, str] | None = None, project: Path | None = None) -> Places:
    """The folders of data and settings, in this environment and for this project folder (default: the current one).

    Raises UsageError if ADAPTSIM_HOME cannot be a folder.
    """
    from sim.storage.places import data_folder  # not above: another `sim` may hide ours, and app.py says so

    env = os.environ if env is None else env
    project = Path.cwd() if project is None else project
    config = Path(platformdirs.user_config_dir("adaptsim", appauthor=False))
    if home := env.get("ADAPTSIM_HOME"):
        root = Path(home).expanduser().absolute()
        ancestor = next(folder for folder in (root, *root.parents) if folder.exists())
        if not ancestor.is_dir():
            raise UsageError(f"ADAPTSIM_HOME = {home}: {ancestor} is not a folder; name one of yours, or unset it")
        trust_file = (config if _is_inside(root, project) else root) / TRUST_FILE
        return Places(data_folder(env), root / "config.toml", project / PROJECT_FILE, trust_file)
    data = data_folder(env)
    return Places(data, config / "config.toml", project / PROJECT_FILE, config / TRUST_FILE)


def _is_inside(folder: Path, project: Path) -> bool:
    """Whether `folder` is `project` or lies below it, by its own path or by the target of its links."""
    return folder.is_relative_to(project.absolute()) or folder.resolve().is_relative_to(project.resolve())


def load(
    flags: Mapping[str, Any] | None = None, env: Mapping[str, str] | None = None, project: Path | None = None
) -> Resolved:
    """All settings; a flag of None was not given. Raises UsageError naming the source, the key and the known keys."""
    env = os.environ if env is None else env
    where = places(env, project)
    values: dict[str, Any] = Config().model_dump()
    sources = dict.fromkeys(values, "default")
    layers = (
        (str(where.user_file), _read(where.user_file)),
        (str(where.project_file), _read(where.project_file)),
        ("environment", _from_environment(env)),
        (FLAG, {key: value for key, value in (flags or {}).items() if value is not None}),
    )
    for source, layer in layers:
        checked = _checked(layer, source, strict=source not in ("environment", FLAG))
        if checked.get("rig"):  # a path in a settings file is relative to that file
            folder = Path.cwd() if source in ("environment", FLAG) else Path(source).parent
            checked["rig"] = str((folder / Path(checked["rig"]).expanduser()).absolute())
        if checked.get("task", "").partition(":")[0].endswith(".py"):  # the file of a task
            folder = Path.cwd() if source in ("environment", FLAG) else Path(source).parent
            checked["task"] = str((folder / Path(checked["task"]).expanduser()).absolute())
        for key in ("checkpoint", "object", "recorded", "world"):
            if checked.get(key, "").startswith("~"):
                checked[key] = str(Path(checked[key]).expanduser())
        if "answer_with" in checked:  # a program moves a robot, unless the place that names it says otherwise
            values["answer_moves"], sources["answer_moves"] = "robot", "default"
        elif source != FLAG:
            checked.pop("answer_moves", None)
        values |= checked
        sources |= {key: f"{_PREFIX}{key.upper()}" if source == "environment" else source for key in checked}
    own_rigs = {str(where.user_file.with_name(RIG_FILE))} if where.home_is_own else set[str]()
    if values["rig"] and sources["rig"] not in where.foreign_settings:
        own_rigs.add(values["rig"])
    if not values["rig"] and (file := next((file for file in where.rig_files if file.is_file()), None)):
        values["rig"], sources["rig"] = str(file), f"found in {file.parent}"
    config = Config(**values)
    config._own_rigs = frozenset(own_rigs)
    return Resolved(config, sources, where)


def _read(path: Path) -> dict[str, Any]:
    try:
        return read_table(path)
    except FileNotFoundError:
        return {}
    except Unreadable as error:
        raise UsageError(f"{path} {error}") from error


def _from_environment(env: Mapping[str, str]) -> dict[str, str]:
    names = (name for name in env if name.startswith(_PREFIX) and not name.startswith(_OF_TESTS))
    return {name.removeprefix(_PREFIX).lower(): env[name] for name in names if name not in _NOT_SETTINGS}


def _checked(layer: Mapping[str, Any], source: str, *, strict: bool) -> dict[str, Any]:
    try:
        return Config.model_validate(dict(layer), strict=strict).model_dump(include=set(layer))
    except ValidationError as error:
        raise UsageError(f"{source}: {_message(error)}") from error


def _message(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    key = location(first["loc"])
    keys = tuple(Config.model_fields)
    if first["type"] == "extra_forbidden":
        return unknown(key, key, keys, "Known keys")
    if first["type"] == "literal_error":
        choices = first["ctx"]["expected"].replace(" or ", ", ").replace("'", "")
        return f"{key} = {first['input']!r}: choose one of {choices}"
    return (
        f"{key} = {first['input']!r}: {plain(first['msg'])} ({Config.model_fields[str(first['loc'][0])].description})"
    )
