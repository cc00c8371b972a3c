"""Rules for the end of a session: functions around its loop, each of which is called after every stage.

A rule sees the session and the stage that was just done, and may ask the operator. A session ends at the first rule
that says so, also in the middle of an iteration, and its report is drawn. A new rule is a function here that
`running.SessionRequest` gets.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

from adaptsim_cli.screen.keys import Key, agree
from adaptsim_cli.session.flow import RunningSession
from adaptsim_cli.session.history import result_of
from adaptsim_cli.session.operator import Unattended
from sim.adaptation.stages import RunTrial, Show, Stage

EndRule = Callable[[RunningSession, Stage], bool]
"""(session, the stage just done) -> whether the session ends here."""


def after_iterations(most: int) -> EndRule:
    """Ends when `most` iterations are complete."""
    complete = count(1)
    return lambda session, stage: isinstance(stage, Show) and next(complete) >= most


def before_adapting(session: RunningSession, stage: Stage) -> bool:
    """Ends when the trials of an iteration are complete, because a rollout has no adaptation."""
    return not isinstance(session.next_stage(), RunTrial)


def at_the_verdict(session: RunningSession, stage: Stage) -> bool:
    """Ends where the verdict says stop."""
    return isinstance(stage, Show) and result_of(session.store, stage.iteration).verdict.stops


def asked_at_the_verdict(most: int) -> EndRule:
    """Asks where the verdict says stop. If nobody can be asked, it says that `most` iterations were ordered, and
    continues.
    """

    def ends(session: RunningSession, stage: Stage) -> bool:
        if not (isinstance(stage, Show) and at_the_verdict(session, stage)):
            return False
        if isinstance(session.operator, Unattended):
            session.screen.note(
                f"The verdict says stop. The session goes on, because this command was given --iterations {most} and "
                "--yes, so nobody can be asked. With --until-done it would end here."
            )
            return False
        on = agree("to run the next iteration", "The session goes on with the next iteration.")
        end = Key("", "to end here", "The command ends. The session can be continued at any time.", is_way_out=True)
        return session.screen.choose("The verdict says stop. Run another iteration?", on, end) != "y"

    return ends
