"""The recipes of the page, as they stand there: shares of a job array, and two Dask workers, one of which dies."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest
from distributed import Client
from documents import ROOT, code_in

PAGE = "docs/guide/beyond-one-computer.md"
TIMES = ("wall_s", "cpu_s")

pytestmark = [
    pytest.mark.long,
    pytest.mark.timeout(300),
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning", "ignore::UserWarning"),
]


def block(containing: str) -> str:
    (found,) = [text for text in code_in(PAGE, "sh") if containing in text]
    return found


@pytest.fixture(scope="module")
def commands(tmp_path_factory) -> Path:
    """A folder with the program adaptsim."""
    commands: Path = tmp_path_factory.mktemp("bin")
    program = commands / "adaptsim"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m adaptsim_cli "$@"\n')
    program.chmod(0o755)
    return commands


def environment(commands: Path, home: Path) -> dict[str, str]:
    here = f"{commands}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    return {**os.environ, "PATH": here, "PYTHONPATH": str(ROOT), "ADAPTSIM_HOME": str(home)}


@pytest.fixture
def shell(commands, tmp_path) -> dict[str, str]:
    """The environment of a shell in which adaptsim is installed."""
    return environment(commands, tmp_path / "home")


def ran(line: str, env: dict[str, str], **more: str) -> str:
    done = subprocess.run(["bash", "-c", line], env={**env, **more}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def rows(text: str) -> list[dict[str, Any]]:
    """What `adaptsim benchmark --json` printed, without times."""
    return [{key: value for key, value in row.items() if key not in TIMES} for row in json.loads(text)["rows"]]


@pytest.fixture(scope="module")
def alone(commands, tmp_path_factory) -> list[dict[str, Any]]:
    """The rows of the recipes' benchmark, by one process of this computer."""
    line = re.sub(r" --share .*", "", block("SLURM_ARRAY_TASK_ID").splitlines()[-1])
    return rows(ran(f"{line} --json", environment(commands, tmp_path_factory.mktemp("alone")), ADAPTSIM_WORKERS="1"))


def test_the_jobs_of_an_array_are_joined_to_the_same_rows(shell, alone):
    script = block("#SBATCH --array=1-8")
    for job in ("1", "2"):
        done = ran(script, shell, SLURM_ARRAY_TASK_ID=job, SLURM_ARRAY_TASK_COUNT="2", ADAPTSIM_WORKERS="1")
        assert f"Share {job}/2 is complete: 4 sessions in" in " ".join(done.split())
    join = re.sub(r" --share .*", "", script.splitlines()[-1])
    assert rows(ran(f"{join} --json", shell)) == alone


def test_submitit_starts_the_shares_and_the_last_line_joins_them(shell, alone, tmp_path):
    (code,) = code_in(PAGE, "python")
    launcher = tmp_path / "launch.py"
    launcher.write_text(code.replace("SHARES = 4", "SHARES = 2"), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(launcher)],
        env={**shell, "ADAPTSIM_WORKERS": "1"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    logs = "".join(path.read_text() for path in (tmp_path / "adaptsim-jobs").rglob("*.out"))
    assert {"1/2", "2/2"} == set(re.findall(r"Share (\S+) is complete", " ".join(logs.split())))
    join = re.sub(r" --share .*", "", block("SLURM_ARRAY_TASK_ID").splitlines()[-1])
    assert rows(ran(f"{join} --json", shell)) == alone


def test_two_dask_workers_give_the_same_rows_and_one_may_die(shell, alone):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    scheduler, workers, command = [
        line.replace("--port 8786", f"--port {address.rpartition(':')[2]}").replace("127.0.0.1:8786", address)
        for line in block("dask scheduler").splitlines()
    ]
    with beside(scheduler, shell), beside(workers, shell), Client(f"tcp://{address}", set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
        processes = list(client.run(os.getpid).values())
        assert len(set(processes)) == 2
        assert listening(*processes, client.run_on_scheduler(os.getpid)) == {"127.0.0.1"}
        running = subprocess.Popen(["bash", "-c", f"exec {command} --json"], env=shell, stdout=-1, stderr=-1, text=True)
        assert running.stderr is not None
        half_way = next(line for line in running.stderr if re.search(r"sessions: .*\([2-6] of 8\)", line))
        os.kill(processes[0], signal.SIGKILL)
        out, err = running.communicate(timeout=120)
        assert running.returncode == 0, half_way + err
        assert rows(out) == alone


def listening(*processes: int) -> set[str]:
    """The addresses on which these processes, and the parents of workers, accept connections."""
    asked = [psutil.Process(pid) for pid in processes]
    asked += [parent for one in asked for parent in one.parents() if "dask" in " ".join(parent.cmdline()[:2])]
    accepting = [port for one in asked for port in one.net_connections() if port.status == psutil.CONN_LISTEN]
    assert len(accepting) >= 2 * len(processes)
    return {port.laddr.ip for port in accepting}


@contextmanager
def beside(line: str, env: dict[str, str]) -> Iterator[None]:
    """A server of the recipe, while the block runs."""
    assert line.endswith(" &")
    process = subprocess.Popen(line.removesuffix(" &").split(), env=env, stdout=subprocess.DEVNULL, stderr=-3)
    try:
        yield
    finally:
        process.terminate()
        process.wait(timeout=30)
