"""Which solver a session gets."""

from __future__ import annotations

from pathlib import Path

import pytest

from adaptsim_cli.errors import UsageError
from adaptsim_cli.wiring.settings import solver_of
from sim.adaptation.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from sim.errors import UnknownName
from sim.research.methods.q_policy import new_policy, tensors_of
from sim.research.naf.memory import NafMemory
from sim.research.naf.solver import NafSolver, naf_facts, rules_of
from sim.rollouts import Requests, Rollouts
from sim.tasks import get_task


def not_asked(requests: Requests) -> Rollouts:
    raise AssertionError("nothing is simulated before a policy is wanted")


@pytest.fixture
def by_naf(tmp_path: Path) -> Checkpoint:
    """A checkpoint of scooping that was made without an emulator."""
    task = get_task("scooping")
    facts = naf_facts(NafSolver(task, not_asked, rules_of(task, 0.1), NafMemory(task), 1.5))
    folder = save_checkpoint(
        task, tmp_path / "naf", None, tensors_of({"iteration": new_policy(task, "iteration", 0)}), facts
    )
    return load_checkpoint(task, str(folder))


def test_a_checkpoint_made_with_naf_goes_on_with_it(by_naf: Checkpoint, tmp_path: Path) -> None:
    for name in ("", "naf"):
        with solver_of(by_naf, name, 1, tmp_path / "session") as (policies, expectations):
            assert isinstance(policies, NafSolver)
            assert policies.rules.first_budget == 120
            assert expectations.misfit_limit == 1.5
    with pytest.raises(UsageError, match="emulator"), solver_of(by_naf, "emulator", 1, tmp_path):
        pass


def test_beside_naf_an_emulator_still_tells_what_to_expect(tmp_path: Path) -> None:
    checkpoint = load_checkpoint(get_task("scooping"))
    with solver_of(checkpoint, "naf", 1, tmp_path) as (policies, expectations):
        assert isinstance(policies, NafSolver)
        assert expectations is checkpoint.solver
    with solver_of(checkpoint, "", 1, tmp_path) as (policies, expectations):
        assert policies is expectations is checkpoint.solver


def test_an_exact_task_has_its_own(tmp_path: Path) -> None:
    checkpoint = load_checkpoint(get_task("pendulum"))
    with solver_of(checkpoint, "", 1, tmp_path) as (policies, expectations):
        assert policies is expectations is checkpoint.solver
    with pytest.raises(UnknownName, match=r"pendulum .*naf"), solver_of(checkpoint, "naf", 1, tmp_path):
        pass
    with pytest.raises(UsageError, match="emulator, naf"), solver_of(checkpoint, "lqr", 1, tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []
