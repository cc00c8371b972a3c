"""Each sentence of libfranka has its cause and a next step, and an unreachable arm is told by when it fell silent."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from cells import move
from players import arm_of
from sdk_fake import CommandException, FakeSdk, NetworkException

from hw.errors import ArmFault, DeviceUnavailable
from hw.franka.driver import FAULT, LOST, failure
from hw.franka.explanations import AT_REST, CONNECTING, MOVING, STARTING, Phase, unreachable

SENTENCE = re.compile(rb" command (?:rejected|aborted|preempted)[ -~]*")
LIBRARIES = {"fr3": ("pylibfranka", "libfranka.so.*"), "panda": ("panda_py", "../panda_python.libs/libfranka-*.so.*")}


def sentences(model: str) -> set[str]:
    """What the library of a model's SDK may say of a refused or ended command."""
    module, library = LIBRARIES[model]
    spec = importlib.util.find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    file = max(Path(spec.origin).parent.glob(library))
    return {match.decode().strip() for match in SENTENCE.findall(file.read_bytes())}


@pytest.mark.parametrize("model", LIBRARIES)
def test_every_sentence_of_an_sdk_about_a_command_has_a_cause_and_a_next_step(model: str) -> None:
    texts = sentences(model)
    assert len(texts) >= 8
    for text in texts:
        whole = f"libfranka: Move {text}" + '"Idle")!' * text.endswith("(")
        said = failure(CommandException(whole), model, "172.16.0.2")
        assert said.kind == FAULT
        if "current mode" not in text:
            assert not said.text.startswith("the arm says"), text
            assert re.search("recover|same command again", said.text), text


def test_a_mode_that_is_not_named_is_explained_by_all_that_it_can_be() -> None:
    said = failure(CommandException("libfranka: Set Load command rejected: command not possible in the current mode!"),
                   "panda", "172.16.0.2")  # fmt: skip
    assert re.search("stop button .*guides it by hand.* locked.* another program moves it.*recover", said.text)


@pytest.mark.parametrize(
    ("text", "phase", "words", "never"),
    [
        ("UDP receive: Timeout", CONNECTING, "answers over TCP.*firewall.*switch.*MTU.*ufw allow", "check cable"),
        ("UDP receive: Timeout", STARTING, "took the motion.*no joint was commanded.*switch", "check cable|firewall"),
        ("UDP receive: Timeout", MOVING, "states came until then: check cable, address and power", "firewall|MTU"),
        ("UDP receive: Timeout", AT_REST, "states came until then: check cable, address and power", "firewall|MTU"),
        ("Connection timeout. Please check", CONNECTING, "does not answer .*: check cable", "firewall|until then"),
        ("server closed connection", AT_REST, "closed the connection.*deactivated FCI", "cable"),
        ("TCP connection got interrupted.", MOVING, "closed the connection.*deactivated FCI", "cable"),
        ("could not send UDP data", MOVING, "could not send.*ip address", "firewall"),
        ("incorrect object size", AT_REST, "does not understand.*arm of the rig file", "cable, address"),
    ],
)
def test_the_cause_of_a_silence_follows_from_what_had_answered(text: str, phase: Phase, words: str, never: str) -> None:
    said = unreachable("fr3 at 172.16.0.2", "172.16.0.2", text, phase)
    assert re.search(words, said), said
    assert not re.search(never, said), said
    assert text in said
    assert failure(NetworkException(f"libfranka: {text}"), "fr3", "172.16.0.2", (), phase).kind == LOST


@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_a_silence_while_control_starts_latches_the_arm_and_says_so(model: str) -> None:
    sdk = FakeSdk(k=model == "panda")
    start = "control_joint_position" if sdk.k else "start_joint_position_control"
    path = move([0.1] * 7, 1.0, start_rad=np.array(sdk.q_rad))
    with arm_of(sdk, model) as arm:
        sdk.fails[start] = NetworkException("libfranka: UDP receive: Timeout")
        with pytest.raises(DeviceUnavailable, match=r"no joint was commanded.*no motion begins before a recovery"):
            arm.execute(path)
        del sdk.fails[start]
        with pytest.raises(ArmFault, match="the arm is stopped"):
            arm.execute(path)
        assert "command" not in dict(sdk.calls), "nothing moved"
        arm.recover()
        arm.execute(path)
    assert "command" in dict(sdk.calls)
