"""`adaptsim pretrain --report`, on the pendulum, whose rollouts cost nothing."""

from __future__ import annotations

import dataclasses
import json
import shutil
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from adaptsim_cli import app
from adaptsim_cli.research import phase1_page as phase1
from sim.adaptation.reward_table import ProspectSettings
from sim.research.pretraining.evaluation import EvaluationSettings
from sim.research.pretraining.meta_training import MetaSettings
from sim.research.pretraining.pipeline import PretrainBudget, pretrain
from sim.research.pretraining.verification.policies import Pairs
from sim.research.pretraining.verification.replays import Agreement
from sim.research.pretraining.verification.statistics import rank_correlation
from sim.research.pretraining.verification.verify import (
    EmulatorHeldOut,
    Errors,
    Verification,
    VerificationSettings,
    load_pretrained,
    reliability_bins,
    verify,
)
from sim.rollouts import serial_executor
from sim.tasks import get_task
from sim.types import Estimate

pytestmark = pytest.mark.long

BUDGET = PretrainBudget(
    meta=MetaSettings(episodes=8, parallel=8),
    prospects=ProspectSettings(candidates=16, truths=64, contexts=2),
    evaluation=EvaluationSettings(targets=3, iterations=2, rollouts=1, oracle=16),
)


@cache
def finished() -> TemporaryDirectory[str]:
    folder = TemporaryDirectory()
    with serial_executor() as executor:
        pretrain(get_task("pendulum"), Path(folder.name), BUDGET, 0, executor, lambda stage, done, total: None)
    return folder


@pytest.fixture
def made(tmp_path) -> Path:
    """The folder of a pretraining, to be reported on."""
    return Path(shutil.copytree(finished().name, tmp_path / "made"))


@pytest.fixture
def verification(made: Path) -> Verification:
    with serial_executor() as executor:
        return verify(
            load_pretrained(get_task("pendulum"), made),
            VerificationSettings(),
            executor,
            lambda stage, done, total: None,
        )


def test_the_command_writes_the_report_of_a_finished_folder(made, capfd):
    docs = made.parent / "docs"
    call = ["pretrain", "--task", "pendulum", "--out", str(made), "--report", "--docs", str(docs), "--workers", "1"]
    assert app.run([*call, "--json"]) == 0
    out, err = capfd.readouterr()
    told = json.loads(out)
    assert told["report"] == str(docs / "phase1.md")
    assert told["card"]["task"] == "pendulum"
    assert f"Report: {docs / 'phase1.md'}" in err
    text = (docs / "phase1.md").read_text()
    assert "\n## Balance a double pendulum" in text
    assert "| every reward |" in text
    assert "### Emulator" not in text  # solved exactly
    pictures = sorted((docs / "figures").iterdir())
    assert [p.name for p in pictures] == ["phase1-pendulum-learning.png"]
    assert 5_000 < pictures[0].stat().st_size < 200_000
    assert app.run(call) == 0
    assert (docs / "phase1.md").read_text() == text


def test_a_folder_for_documents_needs_a_report(made, refused):
    new = made.parent / "new"
    assert "add --report" in refused(2, "pretrain", "--task", "pendulum", "--out", str(new), "--docs", "docs")
    assert not new.exists()


def test_wide_targets_have_a_section_of_their_own(made, capfd):
    wide, docs = made.parent / "wide", made.parent / "docs"
    with serial_executor() as executor:
        pretrain(get_task("pendulum"), wide, BUDGET.on_targets("wide"), 0, executor, lambda stage, done, total: None)
    for folder in (made, wide):
        call = ["pretrain", "--task", "pendulum", "--out", str(folder), "--report", "--docs", str(docs)]
        assert app.run([*call, "--workers", "1"]) == 0
    text = (docs / "phase1.md").read_text()
    paper, beyond = (text.split(f"<!-- begin pendulum{s} -->")[1].split("<!-- end")[0] for s in ("", "-wide"))
    assert "`adaptsim pretrain --task pendulum --episodes 8 --judged 3`" in paper
    assert "(in Ω, as in the paper)" in paper
    assert "`adaptsim pretrain --task pendulum --targets wide --episodes 8 --judged 3`" in beyond
    assert "(in Ω and the margin around it)" in beyond
    capfd.readouterr()


def test_sizes_that_are_not_the_usual_ones_are_part_of_the_command(verification):
    made = verification.pretrained
    learnt = dataclasses.replace(made, emulator=object())
    assert phase1.command(made) == "adaptsim pretrain --task pendulum --episodes 8 --judged 3"
    usual = dataclasses.asdict(PretrainBudget.full(made.task))
    assert phase1.command(dataclasses.replace(made, plan={**made.plan, "budget": usual})) == (
        "adaptsim pretrain --task pendulum"
    )
    planned = {**made.plan, "budget": {**usual, "rollouts": 512, "denser": 0}}
    told = phase1.command(dataclasses.replace(learnt, plan=planned))
    assert told == "adaptsim pretrain --task pendulum --rollouts 512 --denser 0"
    small = dataclasses.asdict(PretrainBudget.small(made.task))
    told = phase1.command(dataclasses.replace(learnt, plan={**made.plan, "budget": small}))
    assert told == "adaptsim pretrain --task pendulum --budget small"


def test_the_rewards_of_an_exact_task_hold(verification):
    assert verification.replays is not None
    for found in verification.replays.returns:
        assert found.paid == pytest.approx(found.true, abs=1e-3)
    assert verification.pairs is None
    assert verification.held_out is None


def test_a_whole_report_names_every_number(verification, tmp_path):
    rng = np.random.default_rng(0)
    probability = rng.random(500)
    held = EmulatorHeldOut(
        trained_on=4096,
        everywhere=Errors(500, 0.7, 0.91, 0.068, 0.0042, 0.0231),
        inside=Errors(120, 0.6, 0.95, 0.05, 0.003, 0.02),
        calibration_error=0.021,
        reliability=reliability_bins(probability, rng.random(500) < probability),
        position_errors=rng.lognormal(-5.5, 1.0, 500),
    )
    assert verification.replays is not None
    agreement = Agreement("iteration", 832, Estimate(0.9, 0.88, 0.92), Estimate(0.8, 0.78, 0.82), 0.01, 0.04)
    whole = dataclasses.replace(
        verification,
        held_out=held,
        pairs=_pairs(rng, noise=0.05),
        replays=dataclasses.replace(verification.replays, agreements=(agreement,)),
    )
    document = phase1.write(whole, tmp_path, "adaptsim pretrain --task pendulum")
    text = document.read_text()
    for wanted in (
        "| inside Ω | 120 | 95.0 % | 60.0 % | 0.0500 | 3.0 mm | 20.0 mm |",
        "Calibration error of the outcome (expected, ten bins): 0.021.",
        "52 pairs (E, E_s)",
        "+0.050 (+0.020 to +0.080)",
        "the bar of 0.9 is reached",
        "| the last iteration (the paper's) | 832 | 90.0 % (88.0 % to 92.0 %) | 80.0 % | 1.0 % | 4.0 % |",
    ):
        assert wanted in text
    assert "{{" not in text
    for picture in ("emulator", "policies", "learning"):
        name = f"phase1-pendulum-{picture}.png"
        assert f"(figures/{name})" in text
        assert (tmp_path / "figures" / name).stat().st_size < 200_000


def _pairs(rng: np.random.Generator, noise: float) -> Pairs:
    truth = rng.random((13, 4))
    rewards = truth[:, :, None] + rng.normal(0.0, 0.2, (13, 4, 10))
    expected = truth + rng.normal(0.0, noise, truth.shape)
    estimate = Estimate(0.05, 0.02, 0.08)
    return Pairs(rewards, rewards, expected, estimate, estimate, rank_correlation(expected, rewards, rng), 48)


def test_a_section_replaces_its_own_and_leaves_the_others():
    one = phase1.merged("", "scooping", "## Scooping\n\nfirst")
    two = phase1.merged(one, "pushing", "## Pushing")
    three = phase1.merged(two, "scooping", "## Scooping\n\nsecond")
    assert three.index("## Pushing") < three.index("## Scooping")  # as the tasks are listed
    assert "first" not in three
    assert three.count("## Scooping") == 1
    assert three.startswith("# Phase 1")
    assert phase1.merged(three, "pushing", "## Pushing") == three
