"""The questions of a session to the operator: a person at a terminal, or nobody (`--yes`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from rich.text import Text

from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen import views
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key, agree, enter, stop
from adaptsim_cli.screen.release import Release
from adaptsim_cli.session.live_trial import PlannedTrial
from adaptsim_cli.session.records import MotionRecord, TrialRecord
from adaptsim_cli.session.store import SessionStore
from hw.types import Array
from perception.types import Outcome
from sim.adaptation.stages import RunTrial

Choices = dict[Outcome, float]
"""Outcome that a track can support -> its reward."""


@dataclass(frozen=True)
class Review:
    """The judgement of a tracked trial. If neither field is set, the trial counts as it was tracked."""

    outcome: Outcome | None = None  # it counts with this one, which the operator saw
    rejected: str = ""  # why it does not count


class Operator(Protocol):
    """Every question of a session. Each may raise StoppedByOperator."""

    def repeat_interrupted(self, stage: RunTrial) -> None:
        """Called if a motion was started and never completed. Returns once the trial may be repeated."""

    def placed(self, what: str, wanted_m: Array, real: bool) -> None:
        """Returns once `what` lies at `wanted_m` (2,), or the simulated lab may put it there."""

    def approve(self, trial: MotionRecord, planned: PlannedTrial, real: bool, release: Release) -> None:
        """Returns once the trial may start, which `release` then lets begin."""

    def rejected_already(self) -> str:
        """Why the trial does not count, if the operator has said so while the arm went back; else empty."""

    def review(self, tracked: TrialRecord, choices: Choices) -> Review:
        """Accept the tracked outcome, overrule it with one of `choices`, or have the trial repeated."""

    def decide(self, why: str, tracked: TrialRecord, choices: Choices) -> Review:
        """Called if the camera did not see how the trial ended: the outcome that a person saw, or a repetition."""

    def try_again(self, stage: RunTrial) -> bool:
        """Whether to set up the trial again after the object was not found, was misplaced, or was lost in tracking."""


_ACCEPT = enter("to accept", "The trial counts as it was tracked. Later: adaptsim sessions amend.")
_OVERRULE = Key(
    "o", "to amend the outcome", "The trial counts with the outcome that you saw; you choose it from a list."
)
_REDO = Key("r", "to reject it", "The trial is made again; you say why. Later: adaptsim sessions accept.")
_LATER = stop("The command ends. The trial is recorded; the same command asks for its review again, and nothing moves.")
_LEAVE = stop("The command ends; everything completed is stored.")
_SAW = Key("o", "to say what you saw", "You choose the outcome from a list; the trial counts with it.")
_REPEAT = Key("r", "to repeat the trial", "It does not count, and is made again.")
_UNSEEN = "The camera lost sight of the object. Say only what you saw yourself; else repeat the trial."
_BACK = Key("", "to go back", "Nothing is amended.", is_way_out=True)
_REVIEW = "Outcome and reward come from the recording or from the answer. Compare them with what you saw yourself."


@dataclass(frozen=True)
class Attended:
    """An operator: a person at the terminal."""

    screen: Screen

    def repeat_interrupted(self, stage: RunTrial) -> None:
        """See `Operator`; the person looks at the arm first."""
        self.screen.note(
            f"Trial {stage.key.number} was interrupted after its motion had started: "
            "the arm and the object may have moved."
        )
        question = "Have you looked: is the arm at rest and its path clear?"
        yes = agree("to repeat this trial", "The trial begins again; the program asks again before the arm moves.")
        if self.screen.choose(question, yes, _LEAVE) == "q":
            raise StoppedByOperator("stopped by the operator; everything completed is stored")

    def placed(self, what: str, wanted_m: Array, real: bool) -> None:
        """See `Operator`."""
        if real:
            then = f"The camera finds the {what}, and the motion is planned for its place. Nothing moves yet."
            self.screen.go_on(f"Put the {what} at {_spot(wanted_m)}.", "when it lies there", then=then)
        else:
            then = f"The lab places the {what}, the camera finds it, and the motion is planned. Nothing moves yet."
            self.screen.go_on(f"The simulated lab puts the {what} at {_spot(wanted_m)}.", then=then)

    def approve(self, trial: MotionRecord, planned: PlannedTrial, real: bool, release: Release) -> None:
        """See `Operator`."""
        if planned.overlay_file is not None:
            self.screen.file("  Detection", planned.overlay_file)
        asking = release if release.screen else Release(self.screen)
        asking.announced(f"{planned.announcement}.", planned.digest, planned.then, "everything completed is stored")

    def rejected_already(self) -> str:
        """See `Operator`; r and Enter, typed while the arm went back."""
        return (self._reason() or "") if self.screen.has_typed(_REDO) else ""

    def review(self, tracked: TrialRecord, choices: Choices) -> Review:
        """See `Operator`; Enter accepts."""
        keys = (_ACCEPT, *((_OVERRULE,) if choices else ()), _REDO, _LATER)
        while (answer := self.screen.choose("Is this what you saw?", *keys, explain=_REVIEW)) != "":
            if answer == "q":
                raise StoppedByOperator(
                    "stopped by the operator; this trial is recorded; the same command asks for its review again"
                )
            if answer == "r" and (reason := self._reason()) is not None:
                return Review(rejected=reason)
            if answer == "o" and (outcome := which_outcome(self.screen, tracked, choices)) is not None:
                return Review(outcome)
        return Review()

    def decide(self, why: str, tracked: TrialRecord, choices: Choices) -> Review:
        """See `Operator`; there is no default."""
        self.screen.note(f"{why[0].upper()}{why[1:]}.")
        while True:
            answer = self.screen.choose("How did it end?", _SAW, _REPEAT, _LATER, explain=_UNSEEN)
            if answer == "q":
                raise StoppedByOperator(
                    "stopped by the operator; this trial is recorded; the same command asks again how it ended"
                )
            if answer == "r":
                return Review(rejected=why)
            if (outcome := which_outcome(self.screen, tracked, choices)) is not None:
                return Review(outcome)

    def try_again(self, stage: RunTrial) -> bool:
        """See `Operator`; the person decides."""
        then = "The object is placed again, and the trial begins from there."
        self.screen.go_on("This attempt does not count.", "to repeat this trial", then=then)
        return True

    def _reason(self) -> str | None:
        """Why the trial does not count; None if the operator goes back."""
        explain = "One sentence for the record, e.g. the piece was touched; then the trial is made again."
        reason = self.screen.words("Why does this trial not count? (q: back, it is not rejected):", explain)
        return None if reason is None else reason or "the operator had it redone"


def which_outcome(screen: Screen, record: TrialRecord, choices: Choices) -> Outcome | None:
    """Ask for one of the possible outcomes of a trial, shown with their rewards; None: keep the tracked one."""
    numbered = {str(n): outcome for n, outcome in enumerate(choices, start=1)}
    keys = [
        Key(number, "to choose it", f"{views.words(outcome.value)} (reward {reward:.2f})")
        for number, (outcome, reward) in zip(numbered, choices.items(), strict=True)
    ]
    for key in keys:
        screen.show(f"  {key.typed}  {key.meaning}")
    if record.off_goal_mm is not None and not any(choices.values()):
        screen.show(f"  None earns a reward: it ended {record.off_goal_mm:.0f} mm from the goal.")
    every = Key(f"1 to {len(keys)}", "to choose one", "")
    return numbered.get(screen.choose("Which outcome did you see?", *keys, _BACK, listed=(every, _BACK)))


def choose_amendment(
    screen: Screen, store: SessionStore, record: TrialRecord, choices: Choices, named: str | None
) -> Outcome:
    """The amended outcome of a trial: the one `named`, or one that a person chooses from its pictures.

    Raises UsageError for a name that is not a choice, StoppedByOperator if nothing should change.
    """
    if named is not None:
        outcomes = {outcome.value: outcome for outcome in choices}
        if (outcome := outcomes.get(named.replace(" ", "_"))) is None:
            raise UsageError(f"--outcome {named}: trial {record.trial} can have ended as one of {', '.join(outcomes)}")
        return outcome
    folder = store.trial_folder(*record.position)
    screen.show(f"Trial {record.trial} counts as {record.outcome_words}, reward {record.reward:.2f}.")
    for moment in record.moments:
        screen.plain(f"  {moment.label}, {moment.t_s:.2f} s: {folder / moment.file}")
    if (outcome := which_outcome(screen, record, choices)) is None:
        raise StoppedByOperator("nothing was amended")
    return outcome


@dataclass(frozen=True)
class Unattended:
    """`--yes`: nobody answers.

    It never confirms the motion of a real arm, because `opening` uses `Attended` for real arms.
    """

    screen: Screen
    most_attempts: int = 5

    def repeat_interrupted(self, stage: RunTrial) -> None:
        """See `Operator`; the simulated lab starts from the same state."""
        self.screen.note(
            f"Trial {stage.key.number} was interrupted after its motion had started. "
            "The simulated lab starts over, so the trial is repeated from the same start."
        )

    def placed(self, what: str, wanted_m: Array, real: bool) -> None:
        """See `Operator`; only shows it."""
        self.screen.show(Text(f"  The simulated lab puts the {what} at {_spot(wanted_m)}", style="dim"))

    def approve(self, trial: MotionRecord, planned: PlannedTrial, real: bool, release: Release) -> None:
        """See `Operator`. Raises UsageError for a real arm."""
        if real:
            raise UsageError(
                "--yes never confirms the motion of a real arm; run the command in a terminal, without --yes"
            )

    def rejected_already(self) -> str:
        """See `Operator`; nobody types."""
        return ""

    def review(self, tracked: TrialRecord, choices: Choices) -> Review:
        """See `Operator`; accepts every outcome."""
        return Review()

    def decide(self, why: str, tracked: TrialRecord, choices: Choices) -> Review:
        """See `Operator`; nobody saw it, so the trial is repeated."""
        return Review(rejected=why)

    def try_again(self, stage: RunTrial) -> bool:
        """See `Operator`; a fixed number of attempts."""
        return stage.key.attempt + 1 < self.most_attempts


def _spot(xy_m: Array) -> str:
    return f"x = {xy_m[0]:.3f} m, y = {views.signed(xy_m[1], 3)} m"
