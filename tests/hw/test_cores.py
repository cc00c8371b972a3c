"""Only the cores that the process was given: by affinity, and by the quota of its control groups."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hw.computer import usable_cores

COUNTED = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}); "


@pytest.fixture
def ninety_six(monkeypatch: pytest.MonkeyPatch) -> None:
    """A node of 96 cores, all of them permitted."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(96)))


def system(folder: Path, groups: str, **quotas: str) -> Path:
    """A folder with `proc/self/cgroup` and the named files below `sys/fs/cgroup`."""
    files = {"proc/self/cgroup": groups, **{f"sys/fs/cgroup/{name}": text for name, text in quotas.items()}}
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


@pytest.mark.parametrize(
    ("groups", "quotas", "cores"),
    [
        ("0::/\n", {"cpu.max": "400000 100000\n"}, 4),
        ("0::/\n", {"cpu.max": "max 100000\n"}, 96),
        ("0::/\n", {"cpu.max": "150000 100000\n"}, 2),
        ("0::/\n", {"cpu.max": "1000 100000\n"}, 1),
        ("0::/job/step\n", {"job/step/cpu.max": "max 100000\n", "job/cpu.max": "200000 100000\n"}, 2),
        ("0::/job/step\n", {"job/step/cpu.max": "300000 100000\n", "job/cpu.max": "800000 100000\n"}, 3),
        ("0::/host/path/of/a/container\n", {"cpu.max": "200000 100000\n"}, 2),
        ("4:cpu,cpuacct:/job\n", {"cpu/job/cpu.cfs_quota_us": "500000", "cpu/job/cpu.cfs_period_us": "100000"}, 5),
        ("4:cpu,cpuacct:/job\n", {"cpu/job/cpu.cfs_quota_us": "-1", "cpu/job/cpu.cfs_period_us": "100000"}, 96),
        ("4:memory:/job\n", {"cpu.max": "100000 100000\n"}, 96),
        ("0::/\n", {"cpu.max": "nonsense"}, 96),
    ],
)
def test_the_quota_of_a_control_group_counts(groups, quotas, cores, ninety_six, tmp_path):
    assert usable_cores(system(tmp_path, groups, **quotas)) == cores


def test_a_system_without_control_groups_has_its_affinity(ninety_six, tmp_path):
    assert usable_cores(tmp_path) == 96


def test_affinity_limits_the_quota(monkeypatch, tmp_path):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {5, 7})
    assert usable_cores(system(tmp_path, "0::/\n", **{"cpu.max": "800000 100000\n"})) == 2


def test_a_process_pinned_to_one_core_starts_one_worker():
    program = COUNTED + "from sim.rollouts.executors import process_pool; print(process_pool()._max_workers)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "1\n"
