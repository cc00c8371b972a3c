"""Tasks that a Python file declares (`adaptsim.task`): loading the file, and finding its tasks by name afterwards.

A file is executed once per content. Its tasks are registered in the user's data folder, by name, with the absolute path
of the file; so a worker process, or a later command, finds a task by its name alone.
"""

from __future__ import annotations

import builtins
import hashlib
import os
import shlex
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

from hw.bounded import Unreadable, read_bytes, read_table
from sim.errors import SimError, TaskError, UnknownName
from sim.storage.files import write_toml
from sim.storage.places import data_folder
from sim.tasks.task import Task, TaskFile

MOST_BYTES = 2**20
SUFFIX = ".py"

SLOW_S = 10.0
"""A file that takes longer to load may be in an endless loop; with large packages, loading takes a few seconds."""


@dataclass(frozen=True)
class Registered:
    """The stored facts of a task of a file."""

    file: str
    sha256: str
    worlds: tuple[str, ...]


def is_file(text: str) -> bool:
    """Whether the name of a task is the path of a file."""
    return text.partition(":")[0].endswith(SUFFIX)


def registered() -> Mapping[str, Registered]:
    """The tasks of files by name; damaged entries are left out."""
    return {path.stem: entry for path in sorted(_folder().glob("*.toml")) if (entry := _entry(path)) is not None}


def chosen(text: str) -> Task:
    """The task of `FILE.py`, or of `FILE.py:NAME` if it declares several. Raises TaskError, UnknownName."""
    path, _, name = text.partition(":")
    return _chosen(load(Path(path)), Path(path), name)


def register(text: str) -> Task:
    """The same as `chosen`; from now on the task can also be found by its name. Raises TaskError, UnknownName."""
    task = chosen(text)
    assert task.file is not None, "a task of a file"
    entry, place = Registered(task.file.path, task.file.sha256, tuple(task.worlds)), _folder() / f"{task.name}.toml"
    if _entry(place) != entry:
        write_toml(place, asdict(entry))
    return task


def named(name: str) -> Task | None:
    """The task of that name of a file that was loaded or registered before; None without one.

    Raises TaskError if its file is gone or does not declare it any more.
    """
    entry = _entry(_folder() / f"{name}.toml")
    if entry is None:
        return _loaded().get(name)
    if not Path(entry.file).is_file():
        raise TaskError(
            f"the task {name} was declared by {entry.file}, and there is no such file any more: give its new place "
            "with --task FILE.py"
        )
    return _chosen(load(Path(entry.file)), Path(entry.file), name)


def of_file(file: TaskFile, name: str) -> Task:
    """The task as declared by that content of the file. Raises TaskError if the file has changed since."""
    path = Path(file.path)
    if (digest := _digest(path)) != file.sha256:
        raise TaskError(
            f"{path} has changed since this command began ({file.sha256[:12]}, now {digest[:12]}): run it again"
        )
    return _chosen(load(path), path, name)


def load(path: Path) -> tuple[Task, ...]:
    """The tasks that a file declares, in its order. Raises TaskError naming the line that fails."""
    place = path.expanduser().absolute()
    tasks = _executed(place, _digest(place))
    _loaded().update({task.name: task for task in tasks})
    return tasks


def line_of(error: BaseException, path: str) -> str:
    """The place of an error in the file: `FILE, line 7`, or the file alone."""
    if isinstance(error, SyntaxError) and error.filename == path:
        return f"{path}, line {error.lineno}"
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
    return f"{path}, line {lines[-1]}" if lines else path


@contextmanager
def user_code(path: str | None, sentence: Callable[[str], str]) -> Iterator[None]:
    """A block that calls code of the file at `path`. Any error in it becomes a TaskError, which names the line of the
    file.

    `sentence` gets the failure in words, `raises ValueError: ...` or `exits`. Errors of this program pass unchanged.
    """
    try:
        yield
    except SimError:
        raise
    except (Exception, SystemExit) as error:  # the user's code may raise anything
        failure = "exits" if isinstance(error, SystemExit) else f"raises {type(error).__name__}: {error}"
        where = f"{line_of(error, path)}: " if path else ""
        raise TaskError(where + sentence(failure)) from error


def caller_line(path: str) -> int | None:
    """The line of the file that is being executed; None outside of it."""
    frame = sys._getframe(1)
    while frame is not None:
        if frame.f_code.co_filename == path:
            return frame.f_lineno
        frame = frame.f_back  # type: ignore[assignment]
    return None


def note_declaration(path: str, name: str) -> None:
    """Note that the file, if it is being loaded, declares a task of that name.

    Raises TaskError naming both lines if it has declared one before, which nothing could find any more.
    """
    lines, line = _declaring().get(path), caller_line(path)
    if lines is None or line is None:
        return
    if name in lines:
        raise TaskError(
            f"{path} declares two tasks named {name}, in line {lines[name]} and in line {line}: rename one of the "
            "functions"
        )
    lines[name] = line


def confine(path: str) -> None:
    """From now on, code of the file can neither end nor fork this process, nor read the keyboard. A TaskError names the
    line that tries it.

    Code of other files is not affected.
    """
    _guard()
    _confined().add(path)


@cache
def _confined() -> set[str]:
    """The files whose code is confined."""
    return set()


@cache
def _guard() -> None:
    def guard(module: Any, name: str, shown: str, right: str) -> None:
        original = getattr(module, name)

        def guarded(*values: Any) -> Any:
            for path in _confined():
                if (line := caller_line(path)) is not None:
                    raise TaskError(f"{path}, line {line} calls {shown}: {right}")
            return original(*values)

        setattr(module, name, guarded)

    for name in ("_exit", "abort", "fork", "forkpty"):
        if hasattr(os, name):
            guard(os, name, f"os.{name}", "a task may neither end nor double the process")
    guard(builtins, "input", "input", "a task may not wait for the keyboard; everything comes by its arguments")


@contextmanager
def patched(module: Any, functions: Mapping[str, Callable[..., Any]]) -> Iterator[None]:
    """Other functions in a module, for the time of a block."""
    before = {name: getattr(module, name) for name in functions}
    try:
        for name, function in functions.items():
            setattr(module, name, function)
        yield
    finally:
        for name, function in before.items():
            setattr(module, name, function)


@contextmanager
def _noticed(path: str) -> Iterator[None]:
    """After `SLOW_S`, a line on stderr says which line of the file still runs."""
    thread = threading.get_ident()

    def notice() -> None:
        frame = sys._current_frames().get(thread)
        while frame is not None and frame.f_code.co_filename != path:
            frame = frame.f_back
        where = path if frame is None else f"{path}, line {frame.f_lineno}"
        sys.stderr.write(
            f"{where} still runs after {SLOW_S:g} s, because the file is being loaded. Ctrl-C ends the command; to "
            f"examine the file: adaptsim task check {shlex.quote(path)}\n"
        )

    timer = threading.Timer(SLOW_S, notice)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@contextmanager
def _same_folder() -> Iterator[None]:
    """A block that restores the current folder, because the paths of a command are relative to it."""
    before = Path.cwd()
    try:
        yield
    finally:
        os.chdir(before)


def _awake(path: str) -> Mapping[str, Callable[..., Any]]:
    """A `time.sleep` that the file itself may not call while it is loaded."""

    def sleep(seconds: float, _original: Callable[[float], None] = time.sleep) -> None:
        frame = sys._getframe(1)
        if frame.f_code.co_filename == path:
            raise TaskError(f"{path}, line {frame.f_lineno} sleeps for {seconds:g} s: every command would wait for it")
        _original(seconds)

    return {"sleep": sleep}


@cache
def _executed(path: Path, digest: str) -> tuple[Task, ...]:
    module, _declaring()[str(path)] = _module(path, digest), {}
    try:
        confine(str(path))
        with (
            patched(time, _awake(str(path))),
            _same_folder(),
            _noticed(str(path)),
            user_code(str(path), lambda failure: f"it {failure}"),
        ):
            exec(compile(read_bytes(path, MOST_BYTES), str(path), "exec"), module.__dict__)
    except SimError as error:
        del sys.modules[module.__name__]
        where = line_of(error, str(path))
        raise TaskError(str(error) if str(path) in str(error) else f"{where}: {error}") from error
    finally:
        del _declaring()[str(path)]
    tasks = [value for value in vars(module).values() if isinstance(value, Task) and value.file is not None]
    declared = {task.name: task for task in tasks if task.file == TaskFile(str(path), digest)}
    if not declared:
        raise TaskError(f"{path} declares no task: put @adaptsim.task(...) above a function of it")
    return tuple(declared.values())


def _module(path: Path, digest: str) -> ModuleType:
    """An empty module for a file. The file's output goes to stderr with its line, because stdout may carry JSON."""
    spec = spec_from_loader(f"adaptsim_task_{path.stem}_{digest[:12]}", loader=None, origin=str(path))
    assert spec is not None
    module = module_from_spec(spec)
    module.__file__ = str(path)

    def aside(*words: object, **options: Any) -> None:
        where = f"{path}, line {caller_line(str(path))} prints:"
        builtins.print(where, *words, **{"file": sys.stderr, **options})  # noqa: T201 - the user's own

    module.__dict__["print"] = aside
    sys.modules[module.__name__] = module
    if str(path.parent) not in sys.path:  # modules beside it, also those that it imports later
        sys.path.append(str(path.parent))
    return module


@cache
def _loaded() -> dict[str, Task]:
    """The tasks of files that this process has executed, by name."""
    return {}


@cache
def _declaring() -> dict[str, dict[str, int]]:
    """For each file that is being loaded, the line in which it declares each task."""
    return {}


def _chosen(tasks: tuple[Task, ...], path: Path, name: str) -> Task:
    names = ", ".join(task.name for task in tasks)
    if not name and len(tasks) > 1:
        raise TaskError(
            f"{path} declares {len(tasks)} tasks: choose one, as {path}:{tasks[0].name} (there are {names})"
        )
    for task in tasks:
        if name in ("", task.name):
            return task
    raise TaskError(f"{path} declares no task {name}: there is {names}")


def _folder() -> Path:
    return data_folder() / "tasks"


def _entry(path: Path) -> Registered | None:
    try:
        table = read_table(path)
        return Registered(str(table["file"]), str(table["sha256"]), tuple(map(str, table["worlds"])))
    except (OSError, Unreadable, KeyError, TypeError):
        return None


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(read_bytes(path, MOST_BYTES)).hexdigest()
    except FileNotFoundError as error:
        raise UnknownName(f"there is no task file {path}: check the path") from error
    except (OSError, Unreadable) as error:
        raise TaskError(f"the task file {path} cannot be read: {error}") from error
