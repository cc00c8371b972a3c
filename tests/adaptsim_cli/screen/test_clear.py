"""What a person confirms before an arm moves, and when."""

from __future__ import annotations

import numpy as np
import pytest
from toy_rig import ToyLab, flange
from toy_session import ScriptedOperator, attended

from adaptsim_cli.screen.views import clear_to_move, top_speed_m_s
from adaptsim_cli.session.flow import run_iteration
from adaptsim_cli.session.operator import Proposal
from hw.errors import ArmFault
from hw.types import JointPath


def test_it_says_who_does_what_how_long_and_how_fast():
    text = clear_to_move(True, "scoops and goes back", 11.6, 0.804)
    assert text == (
        "Is the work area clear, nobody within reach? THE REAL ROBOT then scoops and goes back: 12 s in all, "
        "the tool at up to 0.80 m/s"
    )
    assert clear_to_move(False, "goes home").endswith("The simulated robot then goes home")


def test_the_speed_is_the_largest_of_all_paths():
    def along(duration_s: float) -> JointPath:
        t_s = np.linspace(0.0, duration_s, round(1000 * duration_s) + 1)
        u = t_s / duration_s
        q_rad = np.zeros((len(t_s), 7))
        q_rad[:, 0] = u**2 * (3.0 - 2.0 * u)  # the toy's first joint is metres along X: 1 m, fastest in the middle
        return JointPath(t_s, q_rad)

    assert top_speed_m_s([along(4.0), along(2.0), along(8.0)], flange) == pytest.approx(1.5 / 2.0, rel=1e-3)


@pytest.mark.parametrize("name", ["fake", "panda"])
def test_it_is_asked_after_every_placing_and_before_anything_moves(name, tmp_path):
    events: list[str] = []

    class Person(ScriptedOperator):
        def placed(self, what: str, wanted_m: np.ndarray, real: bool) -> None:
            events.append("placed")

        def approve(self, proposal: Proposal, real: bool) -> None:
            who = "THE REAL ROBOT" if real else "The simulated robot"
            assert proposal.announcement.startswith(
                f"Is the work area clear, nobody within reach? {who} then comes to the"
            )
            events.append("clear")

    def reflex(trial: int, attempt: int) -> None:
        events.append("moves")
        if (trial, attempt) == (2, 0):
            raise ArmFault("reflex")

    lab = ToyLab(0, hooks={"execute": reflex}, misplaced=frozenset({(3, 0)}))
    with pytest.raises(ArmFault):
        run_iteration(attended(tmp_path, Person(), lab, name))
    run_iteration(attended(tmp_path, Person(), lab, name))
    trial = ["placed", "clear", "moves", "moves", "moves"]
    failed, misplaced = ["placed", "clear", "moves"], ["placed"]
    assert events == [*trial, *failed, *trial, *misplaced, *trial, *trial]
