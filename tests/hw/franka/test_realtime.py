"""What the computer gives the player, each time in a process of its own; and what is said where it does not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from fr3_process import Fr3Process
from players import SETTINGS
from sdk_fake import FakeRobot, FakeSdk

from hw.errors import DeviceUnavailable
from hw.franka import realtime
from hw.franka.connection import DRIVES, Connection
from hw.franka.driver import FAULT, UNAVAILABLE, Failure

PROGRAM = """
import json, os, resource, sys
from pathlib import Path
from hw.franka import realtime
latency, isolated, memlock = sys.argv[1:]
if memlock:
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (int(memlock), int(memlock)))
    os.setresuid(65534, 65534, 65534)
notes = realtime.settle(Path(latency), Path(isolated))
status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
held = [str(one.resolve()) for one in Path("/proc/self/fd").iterdir() if one.exists()]
print(json.dumps([notes, int(status["VmLck"].split()[0]), sorted(os.sched_getaffinity(0)), latency in held]))
"""


def settled(latency: Path, isolated: Path, memlock: str = "") -> tuple[list[str], int, list[int], bool]:
    command = [sys.executable, "-c", PROGRAM, str(latency), str(isolated), memlock]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    result: Any = json.loads(done.stdout)
    return tuple(result)


def test_memory_core_and_processor_are_held_or_it_is_said(tmp_path: Path) -> None:
    latency = tmp_path / "cpu_dma_latency"
    latency.write_bytes(b"\x01" * 4)
    cores = sorted(os.sched_getaffinity(0))
    notes, locked_kb, kept, held = settled(latency, tmp_path / "none")
    assert held
    assert latency.read_bytes() == bytes(4)
    assert (locked_kb > 5_000) != any("memory is not locked" in note for note in notes)
    if len(cores) > 1:
        assert kept == cores[-1:]
    else:
        assert any("only core" in note for note in notes)


def test_a_core_that_the_kernel_leaves_alone_is_taken(tmp_path: Path) -> None:
    cores = sorted(os.sched_getaffinity(0))
    isolated = tmp_path / "isolated"
    isolated.write_text(f"{cores[0]}\n")
    _, _, kept, _ = settled(tmp_path / "none", isolated)
    assert kept == cores[:1]


def test_what_is_not_permitted_is_a_sentence(tmp_path: Path) -> None:
    notes, _, _, held = settled(tmp_path / "none", tmp_path / "none", "8388608" if os.geteuid() == 0 else "")
    assert not held
    assert any("may fall asleep between two cycles" in note and "60-realtime.rules" in note for note in notes)
    if os.geteuid() == 0:
        assert any("memory is not locked (8 MB are allowed): give your user" in note for note in notes)


@pytest.mark.parametrize(
    ("flag", "version", "is_real_time"),
    [
        ("1\n", "#1 SMP PREEMPT_RT Debian 6.1.90-1", True),
        ("", "#1 SMP PREEMPT_RT 6.12.49-rt-x64v3-xanmod1", True),
        ("", "#1 SMP PREEMPT RT Wed Apr 24 11:30:58 CEST 2019", True),
        ("", "#1 SMP PREEMPT_DYNAMIC Debian 6.12.6-1", False),
        ("", "#1 SMP PREEMPT_RTX 6.12", False),
        ("0\n", "#1 SMP PREEMPT_DYNAMIC", False),
    ],
)
def test_a_real_time_kernel_is_one_by_its_flag_or_by_its_version(
    flag: str, version: str, is_real_time: bool, tmp_path: Path
) -> None:
    file = tmp_path / "realtime"
    if flag:
        file.write_text(flag)
    assert realtime.kernel_is_real_time(file, version) is is_real_time
    assert realtime.kernel_has_flag(file) is (flag == "1\n")


def test_a_kernel_that_is_none_is_refused_with_both_signs(tmp_path: Path) -> None:
    assert "PREEMPT_RT" not in os.uname().version
    with pytest.raises(DeviceUnavailable, match=r"neither .*none nor `uname -v` .* says PREEMPT_RT; install one"):
        realtime.claim(tmp_path / "none")


class Greedy(FakeRobot):
    """Takes the highest priority as libfranka does: the FR3's in its constructor, the Panda's in every control."""

    def did(self, name: str, what: object = None) -> None:
        super().did(name, what)
        if name == ("control_joint_position" if self.sdk.k else "Robot"):
            self.sdk.calls.append(("priority", realtime.HIGHEST))


@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_the_priority_that_libfranka_takes_is_lowered_before_the_arm_is_read_or_commanded(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sdk_fake.FakeRobot", Greedy)
    sdk = FakeSdk(k=model == "panda")

    def lower() -> None:
        sdk.calls.append(("priority", realtime.PRIORITY))

    driver = Connection(model, sdk, DRIVES[model], SETTINGS, realtime=True, clock=sdk.clock, take_priority=lower)
    for _ in range(2):
        driver.drive(lambda state, dt_s: (list(sdk.q_rad), True))
    last = 0
    for name, what in sdk.calls:
        last = what if name == "priority" else last
        assert name != "command" or last == realtime.PRIORITY
    driver.reading()
    assert last == realtime.PRIORITY


def test_a_priority_that_is_denied_ends_the_connection_and_the_motion_in_words() -> None:
    sdk, allowed = FakeSdk(k=False), [True]

    def lower() -> None:
        if not allowed[0]:
            raise DeviceUnavailable("no permission for real-time priority 80")

    driver = Connection("fr3", sdk, DRIVES["fr3"], SETTINGS, realtime=True, clock=sdk.clock, take_priority=lower)
    allowed[0] = False
    with pytest.raises(Failure, match="no permission") as raised:
        driver.drive(lambda state, dt_s: (list(sdk.q_rad), True))
    assert raised.value.kind == FAULT
    assert "command" not in dict(sdk.calls)
    with pytest.raises(Failure, match="no permission") as raised:
        Connection("fr3", sdk, DRIVES["fr3"], SETTINGS, realtime=True, clock=sdk.clock, take_priority=lower)
    assert raised.value.kind == UNAVAILABLE


CONNECTS = """
import os, sys
from hw.franka import player, realtime
from hw.franka.playback import Timing
from hw.franka.settings import FrankaSettings
host, is_permitted = sys.argv[1:]
realtime.kernel_is_real_time = lambda *_: True
lowered = []
if is_permitted == "no":
    realtime.take_priority = lambda: lowered.append(realtime.PRIORITY)
driver = player.connect("fr3", FrankaSettings(host), Timing(unwatched_s=20.0))
print(driver.listen(50).priority if is_permitted == "yes" else lowered[-1])
print("lowered after connecting" if is_permitted == "yes" or len(lowered) == 2 else "not lowered")
"""


@pytest.mark.long
def test_a_connected_player_runs_at_its_own_priority_and_not_at_libfrankas(server: Fr3Process) -> None:
    """The maker's library on a kernel that counts as real-time, here without the file that the library looks for.

    A user who may not have the priority sees that it would be taken, before and after connecting.
    """
    command = [sys.executable, "-c", CONNECTS, server.host, "yes" if os.geteuid() == 0 else "no"]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.stdout == f"{realtime.PRIORITY}\nlowered after connecting\n", done.stderr
