"""A drill: whatever forty sessions print and draw about their trials is checked against their records."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import pytest
from campaigns import campaign

from adaptsim_cli import api
from adaptsim_cli.commands import app
from adaptsim_cli.screen import views
from adaptsim_cli.session.advice import HEADLINES
from adaptsim_cli.session.history import results_of
from adaptsim_cli.session.store import SessionStore
from sim.adaptation.judging import SAME_ACTION
from sim.adaptation.method import FAILED
from sim.adaptation.verdict import Kind, Verdict
from sim.tasks import get_task

METHODS = ("adaptsim", "adaptsim", "adaptsim-belief", "random", "udr", "bo", "adaptsim-iteration")
BEST = re.compile(
    r"Best policy: (?:(not yet tried)|that of trials? ([0-9, andto]+) \((?:mean )?reward ([\d.]+)\), "
    r"chosen (?:after (\d+) trials?|before the first trial))\. The simulator now: (.+?)\. (?=[A-Z])"
)
VERDICT = re.compile(r"(?:predicted|estimated) reward ([\d.]+) \(95 % (\S+)(?: to ([\d.]+))?")
GAIN = re.compile(
    r"(Mean reward \d\.\d\d in the first iteration(?:, (\d\.\d\d) in the (?:second|third))?); UDR in \S+ (\d\.\d\d)"
)
TRIAL = re.compile(
    r"Predicted reward ([\d.]+) \(95 % (?:([\d.]+) to ([\d.]+)|–).*?reward ([\d.]+) \(predicted ([\d.]+)\)"
)
STRANGE = re.compile(r"(\d+) of (\d+) trajectories are unlike")
ON = "The verdict says stop. The session goes on, because this command was given --iterations"


def numbers(listed: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", listed)]


def trials_named(listed: str) -> list[int]:
    """The trials that a list such as "2, 5 and 7 to 9" names."""
    spans = re.findall(r"(\d+)(?: to (\d+))?", listed)
    return [trial for first, last in spans for trial in range(int(first), int(last or first) + 1)]


def check_verdicts(judged: Sequence[Verdict], said: str, threshold: float) -> None:
    for verdict, (reward, low, high) in zip(judged, VERDICT.findall(said), strict=True):
        assert float(reward) == pytest.approx(verdict.reward, abs=0.0051)
        if high:
            assert (float(low), float(high)) == pytest.approx(verdict.ci95, abs=0.0051)
            assert low != high, "an interval has a width, or is a dash"
    below = [verdict for verdict in judged if verdict.kind is Kind.STAYS_LOW]
    assert said.count(HEADLINES[Kind.STAYS_LOW]) == len(below)
    assert all(verdict.reward < threshold for verdict in below)


@pytest.mark.parametrize("number", campaign(range(40), 8))
def test_every_claim_of_a_session_is_that_of_its_records(number: int, capfd: pytest.CaptureFixture[str]) -> None:
    iterations, method = 1 + number % 3, METHODS[number % len(METHODS)]
    world = ["wd", "ood-1", "ood-2", "ood-3", "ood-4"][number % 5] if number < 10 else "wd"
    run = ["run-iteration", "--task", "pendulum", "--world", world, "--method", method, "--seed", str(number)]
    assert app.run([*run, "--session", "s", "-n", str(iterations), "--yes"]) == 0
    said = " ".join(capfd.readouterr().out.split())
    session = api.open_session("s")
    trials, task = session.trials, get_task("pendulum")
    per = len(trials) // iterations

    claims, results = BEST.findall(said), results_of(SessionStore.open(session.root, "s"))
    assert len(claims) == iterations, "each iteration names its best policy once"
    for result, (untried, listed, mean, after, now) in zip(results, claims, strict=True):
        known = trials[: result.iteration * per]
        tried = trials_named(listed)
        assert bool(untried) == (not tried)
        if tried:
            rewards = [trial.reward for trial in known if trial.trial in tried]
            assert len(rewards) == len(tried)
            assert float(mean) == pytest.approx(np.mean(rewards), abs=0.0051)
            begun = next(trial.iteration for trial in known if trial.trial == tried[0])
            assert int(after or 0) == (begun - 1) * per, "a policy of an iteration knows the trials before it"
        params = np.array([result.best.params[name] for name in task.parameters.names])
        assert now == views.values(task.parameters, params)
    judged = [result.verdict for result in results if result.verdict.kind is not Kind.TOO_FEW]
    check_verdicts(judged, said, task.adaptation.threshold)
    printed = TRIAL.findall(said)
    for trial, (predicted, low, high, reward, again) in zip(trials, printed, strict=True):
        assert predicted == again == f"{trial.predicted_reward:.2f}", "one prediction is one number"
        assert reward == f"{trial.reward:.2f}"
        if low:
            assert (float(low), float(high)) == pytest.approx((trial.predicted_low, trial.predicted_high), abs=0.0051)
    assert said.count(ON) == sum(result.verdict.stops for result in results[:-1]), "it says each time why it goes on"
    best = task.action.normalise(session.best_policy()(np.zeros(0)))
    off = [np.abs(task.action.normalise(trial.action_array) - best).max() for trial in trials]
    assert trials_named(claims[-1][1]) == [t.trial for t, far in zip(trials, off, strict=True) if far <= SAME_ACTION]
    for strange, of in STRANGE.findall(said):
        assert int(strange) <= int(of) <= len(trials)

    html = session.report().read_text(encoding="utf-8")
    rewarded = re.search(r"trials that earned a reward</dt><dd>(\d+) <small>of (\d+)", html)
    assert rewarded is not None
    assert numbers(" ".join(rewarded.groups())) == [sum(t.reward > FAILED for t in trials), len(trials)]
    assert ("not yet tried" in html) == bool(claims[-1][0])
    means = [np.mean([trial.reward for trial in trials[i * per : (i + 1) * per]]) for i in range(iterations)]
    (sentence, last, of_udr), *_ = GAIN.findall(said)
    assert sentence.startswith(f"Mean reward {means[0]:.2f} in the first iteration")
    assert last == ("" if iterations == 1 else f"{means[-1]:.2f}")
    head = re.search(r'<p class="gain">([^<]+)</p>', html)
    assert head is not None
    assert sentence in head[1], "the page leads with the gain"
    assert (f"UDR in {world} {of_udr} (simulated truth" in head[1]) == (method != "udr")
