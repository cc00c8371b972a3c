"""adaptsim from Python: the commands as functions and values, as `import adaptsim` gives them.

    import adaptsim

    session = adaptsim.begin("pendulum", world="wd", name="study").run()
    session.best().action
    session.posterior().plot().save("posterior.png")

With a robot of your own (`hw="own"`), you ask for trials and report their results:

    session = adaptsim.begin("pushing", hw="own")
    for _ in range(20):
        trial = session.ask()
        session.tell(trial, times_s, states, "upright")

Everything else runs in the simulated lab without questions. A real arm needs a confirmation at a terminal, so only
`adaptsim run-iteration` moves it; its sessions can be opened and read here. Stored files and random numbers are those
of the command line, so both may continue the same session.
"""

from __future__ import annotations

from adaptsim_cli.api.beliefs import SessionPosterior
from adaptsim_cli.api.curves import LearningCurve, SessionComparison
from adaptsim_cli.api.lerobot import PlayedMotion, lerobot
from adaptsim_cli.api.opening import (
    Policy,
    begin,
    benchmark,
    compare,
    open_session,
    read_recording,
    rollout,
    sessions,
    tasks,
    worlds,
)
from adaptsim_cli.api.sessions import BestAction, Iteration, Session
from adaptsim_cli.api.tables import Plot, Rows
from adaptsim_cli.bench.rig import Recording
from adaptsim_cli.screen.outputs.exchange import Question
from adaptsim_cli.screen.outputs.trials import BestRecord
from adaptsim_cli.session.exporting import Row
from adaptsim_cli.session.records import SessionFacts, TrialRecord
from sim.adaptation import methods

__all__ = [
    "BestAction",
    "BestRecord",
    "Iteration",
    "LearningCurve",
    "PlayedMotion",
    "Plot",
    "Policy",
    "Question",
    "Recording",
    "Row",
    "Rows",
    "Session",
    "SessionComparison",
    "SessionFacts",
    "SessionPosterior",
    "TrialRecord",
    "begin",
    "benchmark",
    "compare",
    "lerobot",
    "methods",
    "open_session",
    "read_recording",
    "rollout",
    "sessions",
    "tasks",
    "worlds",
]


def __dir__() -> list[str]:
    return sorted(__all__)
