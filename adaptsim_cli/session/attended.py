"""Who answers the questions of a session: a person at the terminal, or nobody (`--yes`)."""

from __future__ import annotations

from dataclasses import dataclass

from rich.text import Text

from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.operator import Accept, Judged, Overrule, Proposal, Redo, Review
from adaptsim_cli.session.stages import RunTrial
from hw.types import Array
from perception.types import Outcome


@dataclass(frozen=True)
class Attended:
    """A person at the terminal answers."""

    screen: Screen

    def repeat_interrupted(self, stage: RunTrial) -> None:
        """See `Operator`; a person looks at the arm first."""
        self.screen.note(
            f"Trial {stage.key.number} was interrupted after its motion had started: "
            "the arm and the object may have moved."
        )
        self._go_on("Is the arm at rest and its path clear? Enter to repeat this trial, q to stop:")

    def placed(self, what: str, wanted_m: Array, real: bool) -> None:
        """See `Operator`."""
        if real:
            self._go_on(f"Put the {what} at {_spot(wanted_m)}. Enter when it lies there, q to stop:")
        else:
            self._go_on(f"The simulated lab puts the {what} at {_spot(wanted_m)}. Enter to go on, q to stop:")

    def approve(self, proposal: Proposal, real: bool) -> None:
        """See `Operator`."""
        if proposal.overlay is not None:
            self.screen.plain(f"  Detection: {proposal.overlay}")
        self._go_on(f"{proposal.announcement}. Enter to start, q to stop:")

    def review(self, judged: Judged) -> Review:
        """See `Operator`; Enter accepts."""
        self.screen.show(f"  Tracked: {judged.outcome.value.replace('_', ' ')}, reward {judged.reward:.2f}")
        for flag in judged.flags:
            self.screen.note(f"  note: {flag}")
        overrule = "o to overrule the outcome, " if judged.possible else ""
        while True:
            answer = self.screen.ask(f"Enter to accept, {overrule}r to redo this trial, q to stop:")
            if answer == "":
                return Accept()
            if answer == "q":
                raise StoppedByOperator(
                    "stopped by the operator; this trial is recorded; the same command asks for its review again"
                )
            if answer == "r":
                reason = self.screen.ask("Why does this trial not count?")
                return Redo(reason or "the operator had it redone")
            if answer == "o" and judged.possible and (outcome := self._other_outcome(judged)) is not None:
                return Overrule(outcome)

    def try_again(self, stage: RunTrial) -> bool:
        """See `Operator`; a person always may."""
        self._go_on("Enter to set this trial up again, q to stop:")
        return True

    def _other_outcome(self, judged: Judged) -> Outcome | None:
        choices = judged.possible
        for index, (outcome, reward) in enumerate(choices, start=1):
            self.screen.show(f"  {index}  {outcome.value.replace('_', ' ')} (reward {reward:.2f})")
        answer = self.screen.ask("Number of the outcome that you saw, Enter to go back:")
        if answer.isdigit() and 1 <= int(answer) <= len(choices):
            return choices[int(answer) - 1][0]
        return None

    def _go_on(self, question: str) -> None:
        while (answer := self.screen.ask(question)) != "":
            if answer == "q":
                raise _stopped()


@dataclass(frozen=True)
class Unattended:
    """`--yes`: nobody answers. Never confirms the motion of a real arm: `wiring` gives a real one to `Attended`."""

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

    def approve(self, proposal: Proposal, real: bool) -> None:
        """See `Operator`. Raises UsageError for a real arm."""
        if real:
            raise UsageError(
                "--yes never confirms the motion of a real arm; run the command in a terminal, without --yes"
            )

    def review(self, judged: Judged) -> Review:
        """See `Operator`; accepts every outcome."""
        return Accept()

    def try_again(self, stage: RunTrial) -> bool:
        """See `Operator`; a fixed number of attempts."""
        return stage.key.attempt + 1 < self.most_attempts


def _spot(xy_m: Array) -> str:
    return f"x = {xy_m[0]:.3f} m, y = {xy_m[1]:+.3f} m"


def _stopped() -> StoppedByOperator:
    return StoppedByOperator("stopped by the operator; everything completed is stored")
