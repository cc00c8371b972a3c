"""A verdict in words, and the next commands after an iteration. Pure."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from statistics import fmean

from adaptsim_cli.config import Config, is_own, same_lab
from adaptsim_cli.screen.outputs.trials import BestRecord, ControlRecord
from adaptsim_cli.screen.views import predicted_between, signed
from adaptsim_cli.session.records import ROLLOUT, ResultRecord, SessionFacts
from sim.adaptation.method import WORTHWHILE
from sim.adaptation.paired import MOST_FURTHER, WORTH, Claim
from sim.adaptation.verdict import LEAST_TRIALS, Kind, Reason, Verdict

ENOUGH_ITERATIONS = 5
"""The paper's number of iterations."""

Steps = tuple[tuple[str, str], ...]
"""(command, reason) of each step."""

HEADLINES = {
    Kind.GO_ON: "Go on",
    Kind.ENOUGH: "Stop here",
    Kind.HOPELESS: "No action in the ranges seems to work",
    Kind.UNINFORMED: "The predictions say nothing about these trials",
    Kind.TOO_FEW: "Too few trials to judge",
    Kind.NOT_CONVERGED: "Not converged yet",
    Kind.CONVERGED: "Converged",
    Kind.STAYS_LOW: "The reward stays below the threshold of the task",
    Kind.UNKNOWN: "A verdict that only a newer version of adaptsim can word",
}
"""Each kind of verdict in a few words."""


RIG_FIRST = "how the tool is mounted, the object, and the calibration of the camera"
"""What to check first if no action works, on a rig."""


def check_first(task: str, hw: str, calibration: str) -> str:
    """What to check first if no action works: of the rig, of the robot that answers, or of the task."""
    if calibration:
        return RIG_FIRST
    if is_own(hw):
        return "the columns, units and clocks of your robot's reports"
    return f"the ranges and the reward of the task {task}"


def in_words(verdict: Verdict, object_name: str, recordings: str = "", first: str = "") -> str:
    """The verdict in one to three sentences; `recordings` is the folder of recorded trials, "" for new trials.

    `first` names the things to check if no action works (`check_first`). If it is empty, they are those of a rig.
    """
    if verdict.kind is Kind.TOO_FEW:
        return f"{HEADLINES[verdict.kind]}: {verdict.trials} so far, but at least {LEAST_TRIALS} are needed."
    kind = "predicted" if verdict.has_forecast else "estimated"
    reward = f"{kind} reward {verdict.reward:.2f} (95 % {predicted_between(*verdict.ci95)})"
    sentences = [f"{HEADLINES[verdict.kind]}: {reward}{_worth(verdict)}."]
    if verdict.kind is Kind.UNINFORMED and verdict.prediction_error is not None:
        rank = verdict.rank_correlation
        order = "all alike" if rank is None else f"in no better order (rank correlation {signed(rank)})"
        sentences.append(
            f"From the second iteration on, they missed by {verdict.prediction_error:.2f} (root mean square), so "
            f"the mean of the rewards would do no worse, and they were {order}. Another iteration would rest on them: "
            "find the cause first, or measure the best policy itself."
        )
    if Reason.FAILURES in verdict.reasons:
        sentences.append("The latest trials all failed.")
    if verdict.kind is Kind.HOPELESS:
        sentences.append(
            f"Stop here, and check the columns, units and clocks of {recordings}."
            if recordings
            else f"Stop here, and check {first or RIG_FIRST}."
        )
    if verdict.is_inexpressible:
        sentences.append(
            f"No parameters in the ranges explain this {object_name}: {verdict.strange} of {verdict.trials} "
            "trajectories are unlike all that the simulator predicts with them."
            + (f" Check the columns, units and clocks of {recordings} first." if recordings else "")
        )
    elif verdict.kind is Kind.STAYS_LOW:
        sentences.append(
            "The trajectories look like simulated ones, but no parameters that the session has tried give an action "
            f"that suits this {object_name}."
        )
    return " ".join(sentences)


def _worth(verdict: Verdict) -> str:
    """What speaks for or against another iteration."""
    if verdict.kind is Kind.GO_ON and Reason.UNTRIED in verdict.reasons:
        return "; the next iteration tries the policy that the trials have chosen"
    if verdict.kind is Kind.ENOUGH:
        return f"; after two iterations another one rarely gains more than {WORTHWHILE:.2f}"
    if Reason.FULL in verdict.reasons:
        return "; every trial of the last iteration earned 1.00, so nothing is left to gain"
    if Reason.MOVING in verdict.reasons:
        return "; the rewards are good, but the parameters still moved in the last iteration"
    return ""


def control_name(control: str) -> str:
    """The name of the control, for a sentence."""
    return "UDR" if control == "udr" else control


def compared_in_words(shown: ControlRecord) -> str:
    """The result of the pairs, in one sentence."""
    low, high = shown.ci95
    sentence = (
        f"Adapted {shown.mean_reward:.2f}, {control_name(shown.control)} {shown.control_reward:.2f}, "
        f"difference {signed(shown.difference)} ({signed(low)} to {signed(high)}, valid at any time): "
    )
    after = f"after {shown.decided_after} pairs"
    match shown.claim:
        case Claim.SHOWN:
            return sentence + f"shown {after}."
        case Claim.WORSE:
            return sentence + f"the control is better, shown {after}."
        case Claim.NO_GAIN:
            return sentence + f"no gain worth {WORTH:.2f}, shown {after}."
        case Claim.OPEN:
            return sentence + f"not shown yet, {_further(shown)}."


def _further(shown: ControlRecord) -> str:
    if shown.further is not None:
        one = shown.further == 1
        return f"about {shown.further} more pair{'' if one else 's'} {'is' if one else 'are'} needed"
    if shown.pairs < 2:
        return "because one pair says little"
    return f"because this difference needs more than {MOST_FURTHER} further pairs"


def tried_in(best: BestRecord) -> str:
    """Which trials the best policy would repeat, their mean reward, and after how many trials it was chosen.

    "" if the record does not state it.
    """
    if best.tried is None:
        return ""
    if not best.tried or best.tried_reward is None:
        return "not yet tried"
    *before, last = _runs(best.tried)
    listed = f"{', '.join(before)} and {last}" if before else last
    mean = f"{'mean ' if len(best.tried) > 1 else ''}reward {best.tried_reward:.2f}"
    return f"that of trial{'s' if len(best.tried) > 1 else ''} {listed} ({mean}){_chosen(best.chosen_after)}"


def _chosen(after: int | None) -> str:
    """After how many trials a policy was chosen."""
    if after is None:
        return ""
    return f", chosen after {after} trial{'s' * (after != 1)}" if after else ", chosen before the first trial"


_ORDINALS = ("first", "second", "third", "fourth", "fifth")


def gain_in_words(rewards: Sequence[float]) -> str:
    """The mean rewards (n,) of the first and the last complete iteration: Mean reward 0.46 in the first iteration, 0.91
    in the second.
    """
    first, *others = (f"{reward:.2f}" for reward in rewards)
    if not others:
        return f"Mean reward {first} in the first iteration"
    last = len(rewards)
    where = f"the {_ORDINALS[last - 1]}" if last <= len(_ORDINALS) else f"iteration {last}"
    return f"Mean reward {first} in the first iteration, {others[-1]} in {where}"


def best_in_words(best: BestRecord, parameters: str, confirmed: Sequence[float] = ()) -> str:
    """The best policy, and `parameters`, the simulator's at present, in two sentences.

    `confirmed` are the rewards of its trials after the session.
    """
    where = tried_in(best)
    if confirmed and not best.tried:
        count = f"{len(confirmed)} trial{'s' * (len(confirmed) != 1)}"
        where = f"tried in {count} after the session: mean reward {fmean(confirmed):.2f}"
    return f"{f'Best policy: {where}. ' if where else ''}The simulator now: {parameters}."


def _runs(numbers: Sequence[int]) -> list[str]:
    """Increasing numbers as people list them: 3, 4 and 6 to 9. Two neighbours are no run."""
    texts, rest = list[str](), list(numbers)
    while rest:
        length = next((i for i, number in enumerate(rest) if number != rest[0] + i), len(rest))
        texts += [f"{rest[0]} to {rest[length - 1]}"] if length > 2 else [str(number) for number in rest[:length]]
        rest = rest[length:]
    return texts


def answering_flags(config: Config) -> str:
    """The flags that name the program which answers for an own robot."""
    moves = " --answer-moves nothing" if config.answer_moves == "nothing" else ""
    return f" --answer-with {shlex.quote(config.answer_with)}{moves}"


def go_on_with(session: str, answering: str) -> str:
    """The command that continues a session; with the flags of a program that answers, if flags named it."""
    return f"adaptsim run-iteration --session {session}{answering}"


def after_iteration(facts: SessionFacts, result: ResultRecord, answering: str = "") -> Steps:
    """The next commands, the likeliest first; `answering` are the flags of the program that answers, if known."""
    verdict, number = result.verdict, result.iteration
    go_on = go_on_with(facts.name, answering)
    again = (go_on, f"iteration {number + 1}")
    best = f"adaptsim rollout --session {facts.name} --best"
    use, confirm = (best, "one trial with the best policy so far"), (f"{best} --trials 5", "measures what is predicted")
    if is_own(facts.hw):  # no session knows who answers: the configuration, or --answer-with each time
        again = (go_on, f"iteration {number + 1}" + ("" if answering else ", with --answer-with as before"))
        use = (f"adaptsim sessions policy {facts.name}", "the best policy so far, as JSON")
        confirm = (f"adaptsim report {facts.name}", "every trial on one page")
    if facts.recorded:  # there is nothing to try a policy on
        use = confirm = (f"adaptsim compare {facts.name} OTHER", "beside another session, e.g. with --method udr")
    checks = _checks(facts)
    if result.suspicion is not None and facts.calibration:
        where = same_lab(facts.task, facts.hw, facts.world, facts.seed)
        return ((f"adaptsim touch-off {where}", result.suspicion.question), again, *checks[:1])
    match verdict.kind:
        case Kind.HOPELESS:
            return (*checks, use)
        case Kind.UNINFORMED:
            return (*checks, confirm)
        case Kind.STAYS_LOW if verdict.is_inexpressible:
            return (*checks, use)
        case Kind.STAYS_LOW:
            ranges = "the ranges; to set your own: docs/guide/own-objects.md"
            return ((f"adaptsim lab list --task {facts.task}", ranges), use)
        case Kind.ENOUGH | Kind.CONVERGED:
            if result.best.tried:
                confirm = (f"adaptsim report {facts.name}", "every trial on one page")
            is_open = result.control is not None and result.control.claim is Claim.OPEN
            why = "only for more pairs with the control" if is_open else "only to know the reward more precisely"
            steps: Steps = (confirm, (go_on, why))
        case Kind.NOT_CONVERGED if number >= ENOUGH_ITERATIONS:
            steps = (use, (go_on, f"{number} iterations are done; more rarely help"))
        case _:
            steps = (again, use)
    return (*steps, *checks) if verdict.is_inexpressible else steps


def onwards(facts: SessionFacts, results: Sequence[ResultRecord], iterations: int) -> Steps:
    """The next commands for a stored session with this many begun `iterations`; none for a rollout."""
    if facts.method == ROLLOUT:
        return ()
    if results and results[-1].iteration == iterations:
        return after_iteration(facts, results[-1])
    return ((f"adaptsim run-iteration --session {facts.name}", "continues this session"),)


def _checks(facts: SessionFacts) -> Steps:
    """The checks of a rig that has a camera."""
    if not facts.calibration:
        return ()
    where = same_lab(facts.task, facts.hw, facts.world, facts.seed)
    return (
        (f"adaptsim calibrate check {where}", "has the camera moved?"),
        (f"adaptsim touch-off {where}", "measures table and tool again"),
    )
