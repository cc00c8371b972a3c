"""A verdict in words, and what to do next."""

from __future__ import annotations

import pytest

from adaptsim_cli.config import Config, same_lab
from adaptsim_cli.screen.outputs.trials import BestRecord, SuspicionRecord
from adaptsim_cli.session.advice import (
    HEADLINES,
    after_iteration,
    answering_flags,
    best_in_words,
    gain_in_words,
    in_words,
    onwards,
    tried_in,
)
from adaptsim_cli.session.records import ROLLOUT, ResultRecord, SessionFacts
from sim.adaptation.verdict import Kind, Reason, Verdict

FACTS = SessionFacts(
    name="s", task="scooping", hw="fake", world="ood-1", seed=3, method="adaptsim", particles=2, trials=2,
    created="2026-01-01T00:00:00+00:00", checkpoint="", checkpoint_sha256="", calibration="calibrated",
    calibration_sha256="", versions={}, title="t", object_name="piece", parameters=(), context=(), action=(),
)  # fmt: skip
RUN, USE = "adaptsim run-iteration", "adaptsim rollout"
CHECK, TOUCH, RANGES = "adaptsim calibrate check", "adaptsim touch-off", "adaptsim lab list"


def found(kind: Kind, *reasons: Reason, reward: float = 0.5) -> Verdict:
    return Verdict(kind=kind, reasons=reasons, reward=reward, ci95=(0.2, 0.95), trials=8, strange=6)


def best_of(tried: tuple[int, ...] | None, reward: float | None) -> BestRecord:
    return BestRecord(params={}, mean_reward=0.5, trials=4, ci95=(0.2, 0.8), tried=tried, tried_reward=reward)


@pytest.mark.parametrize(
    ("tried", "reward", "words"),
    [
        ((3, 4), 0.905, "that of trials 3 and 4 (mean reward 0.91)"),
        ((2,), 0.0, "that of trial 2 (reward 0.00)"),
        ((1, 4, 5, 6, 9, 11, 12), 0.5, "that of trials 1, 4 to 6, 9, 11 and 12 (mean reward 0.50)"),
        ((3, 4, 5), 0.5, "that of trials 3 to 5 (mean reward 0.50)"),
        ((1, 3, 4), 0.5, "that of trials 1, 3 and 4 (mean reward 0.50)"),
        ((), None, "not yet tried"),
        (None, None, ""),  # a record of an earlier version
    ],
)
def test_a_policy_is_called_untried_only_if_no_trial_would_be_repeated(tried, reward, words):
    assert tried_in(best_of(tried, reward)) == words


@pytest.mark.parametrize(
    ("after", "words"),
    [
        (None, "that of trials 3 to 6 (mean reward 0.91)"),
        (0, "that of trials 3 to 6 (mean reward 0.91), chosen before the first trial"),
        (1, "that of trials 3 to 6 (mean reward 0.91), chosen after 1 trial"),
        (2, "that of trials 3 to 6 (mean reward 0.91), chosen after 2 trials"),
    ],
)
def test_the_best_policy_is_apart_from_the_present_simulator(after, words):
    best = best_of((3, 4, 5, 6), 0.91).model_copy(update={"chosen_after": after})
    assert best_in_words(best, "friction 0.26") == f"Best policy: {words}. The simulator now: friction 0.26."


def test_trials_after_the_session_try_a_policy_that_no_trial_of_it_tried():
    words = "Best policy: tried in 2 trials after the session: mean reward 0.85. The simulator now: friction 0.26."
    assert best_in_words(best_of((), None), "friction 0.26", (0.8, 0.9)) == words
    assert "after the session" not in best_in_words(best_of((2,), 0.9), "friction 0.26", (0.8, 0.9))


def test_the_gain_names_first_and_last_iteration():
    assert gain_in_words([0.456]) == "Mean reward 0.46 in the first iteration"
    assert gain_in_words([0.46, 0.91]) == "Mean reward 0.46 in the first iteration, 0.91 in the second"
    assert gain_in_words([0.1] * 6 + [0.9]) == "Mean reward 0.10 in the first iteration, 0.90 in iteration 7"


def test_nothing_is_measured_again_that_a_trial_has_measured():
    result = ResultRecord(
        iteration=2, trials=(), next_particles=(), best=best_of((3, 4), 0.9), verdict=found(Kind.ENOUGH), timing_s={},
        proposal_s=0.0,
    )  # fmt: skip
    assert [line for line, _ in after_iteration(FACTS, result)][:2] == [
        "adaptsim report s",
        "adaptsim run-iteration --session s",
    ]


HINT = SuspicionRecord(question="Is the edge too high?", why="All were pushed.", look="Pull a strip of paper under it")


def test_a_suspicion_of_the_task_comes_first_with_the_command_that_tells():
    best = BestRecord(params={"mu": 0.3}, mean_reward=0.0, trials=4, ci95=(0.0, 0.2))
    result = ResultRecord(
        iteration=1, trials=(), next_particles=(), best=best, verdict=found(Kind.GO_ON), suspicion=HINT, timing_s={},
        proposal_s=0.0,
    )  # fmt: skip
    first, *rest = after_iteration(FACTS, result)
    assert first == (f"adaptsim touch-off {same_lab('scooping', 'fake', 'ood-1', 3)}", HINT.question)
    assert rest[0][0] == "adaptsim run-iteration --session s"


def steps(verdict: Verdict, iteration: int = 1, facts: SessionFacts = FACTS) -> list[str]:
    best = BestRecord(params={"mu": 0.3}, mean_reward=0.5, trials=4, ci95=(0.2, 0.8))
    result = ResultRecord(
        iteration=iteration, trials=(), next_particles=(), best=best, verdict=verdict, timing_s={}, proposal_s=0.0
    )
    every = (RUN, USE, CHECK, TOUCH, RANGES)
    return [next(start for start in every if line.startswith(start)) for line, _ in after_iteration(facts, result)]


@pytest.mark.parametrize(
    ("kind", "iteration", "expected"),
    [
        (Kind.TOO_FEW, 1, [RUN, USE]),
        (Kind.NOT_CONVERGED, 2, [RUN, USE]),
        (Kind.NOT_CONVERGED, 5, [USE, RUN]),
        (Kind.GO_ON, 1, [RUN, USE]),
        (Kind.ENOUGH, 2, [USE, RUN]),
        (Kind.CONVERGED, 3, [USE, RUN]),
        (Kind.HOPELESS, 3, [CHECK, TOUCH, USE]),
        (Kind.UNINFORMED, 3, [CHECK, TOUCH, USE]),
        (Kind.STAYS_LOW, 4, [RANGES, USE]),
    ],
)
def test_the_next_commands_follow_from_the_kind(kind, iteration, expected):
    assert steps(found(kind), iteration) == expected


def test_a_verdict_on_moving_parameters_says_what_is_good_and_what_is_not_yet():
    good = in_words(found(Kind.NOT_CONVERGED, Reason.MOVING), "piece")
    assert good.startswith("Not converged yet: ") and "the rewards are good, but the parameters still moved" in good
    full = in_words(found(Kind.CONVERGED, Reason.FULL), "piece")
    assert full.startswith("Converged: ") and full.endswith("earned 1.00, so nothing is left to gain.")


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        (Kind.GO_ON, [RUN, USE, CHECK, TOUCH]),
        (Kind.ENOUGH, [USE, RUN, CHECK, TOUCH]),
        (Kind.CONVERGED, [USE, RUN, CHECK, TOUCH]),
        (Kind.STAYS_LOW, [CHECK, TOUCH, USE]),
    ],
)
def test_what_the_simulator_cannot_express_adds_checks_and_never_takes_the_place_of_going_on(kind, expected):
    assert steps(found(kind, Reason.INEXPRESSIBLE, reward=0.95)) == expected


def test_a_target_without_a_camera_has_nothing_to_check():
    without = FACTS.model_copy(update={"calibration": ""})
    assert steps(found(Kind.HOPELESS), facts=without) == [USE]
    assert steps(found(Kind.GO_ON, Reason.INEXPRESSIBLE), facts=without) == [RUN, USE]


@pytest.mark.parametrize("kind", Kind)
def test_every_verdict_has_words_with_its_numbers(kind):
    words = in_words(found(kind, Reason.INEXPRESSIBLE), "piece")
    assert words.startswith(HEADLINES[kind])
    for number in ("8",) if kind is Kind.TOO_FEW else ("0.50", "0.20", "0.95", "6 of 8"):
        assert number in words


def test_beside_a_real_arm_the_world_is_the_hardware():
    assert same_lab("scooping", "fr3", "", 3) == "--task scooping --hw fr3"
    assert same_lab("scooping", "fake", "ood-1") == "--task scooping --world ood-1"


def test_advice_for_recordings_speaks_of_columns_units_and_clocks():
    for kind in (Kind.HOPELESS, Kind.STAYS_LOW):
        words = in_words(found(kind, Reason.INEXPRESSIBLE), "bottle", "my-pushes")
        assert "the columns, units and clocks of my-pushes" in words
        assert "mounted" not in words


def test_an_own_robot_is_continued_with_the_program_that_answered():
    own = FACTS.model_copy(update={"hw": "own", "world": "", "calibration": ""})
    result = ResultRecord(
        iteration=1, trials=(), next_particles=(), best=best_of((), None), verdict=found(Kind.GO_ON), suspicion=HINT,
        timing_s={}, proposal_s=0.0,
    )  # fmt: skip
    (command, _), (policy, _) = after_iteration(
        own, result, answering_flags(Config(answer_with="python my robot.py", answer_moves="nothing"))
    )
    assert command == "adaptsim run-iteration --session s --answer-with 'python my robot.py' --answer-moves nothing"
    assert policy == "adaptsim sessions policy s", "an own robot has no touch-off of ours"


def test_a_stored_session_is_continued_as_its_verdict_says():
    stop = ResultRecord(
        iteration=1, trials=(), next_particles=(), best=best_of((3,), 0.9), verdict=found(Kind.ENOUGH), timing_s={},
        proposal_s=0.0,
    )  # fmt: skip
    assert onwards(FACTS, [stop], 1)[0][0] == "adaptsim report s"
    assert onwards(FACTS, [stop], 2) == ((f"{RUN} --session s", "continues this session"),), "an iteration has begun"
    assert onwards(FACTS.model_copy(update={"method": ROLLOUT}), [], 1) == ()
