"""Question and answer of a trial with a robot of one's own: the two records of ask and tell.

`adaptsim schema own-robot question` and `adaptsim schema own-robot answer` print their JSON schemas. If a key is
removed or gets another meaning, `VERSION` is increased.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from adaptsim_cli.screen.outputs import Quantities, described
from adaptsim_cli.screen.outputs.trials import UNITS
from hw.records import HandWritten, Record
from perception.types import Outcome

VERSION = 1

Numbers = tuple[float, ...]


class PolicyFile(Record):
    """A trained policy that the robot runs in a trial."""

    name: str = described("its name in the library")
    file: str = described("the file or folder of the policy, as the task's `train` made it")


class Question(Record):
    """A question to a robot: make this trial, or measure where the object lies."""

    adaptsim: int = Field(default=VERSION, description="version of question and answer")
    ask: Literal["trial", "place"] = described(
        "trial: make it and report it; place: set the object up near `context` and report its measured context"
    )
    session: str = described("which session")
    task: str = described("which task")
    trial: int = described("number of the trial in the session, from 1; the answer repeats it")
    attempt: int = described("number of the attempt, from 1")
    context: Quantities = described("as measured; to `place`: as wanted, in `units`")
    action: Quantities | None = described("what to do, in `units`; null: it is chosen after `place`")
    policy: PolicyFile | None = Field(
        default=None, description="the trained policy that acts; `action` says what it was trained for"
    )
    goal_m: Numbers | None = described("(x, y) where the object should come to rest, for a task with such a goal")
    units: dict[str, str] = described(UNITS)
    words: dict[str, str] = Field(default={}, description="the categories of `context` and `action` in words")
    times_s: Numbers = described("the moments that the task observes, from the start of the motion")
    state: tuple[str, ...] = described("the columns of a state, each with its unit")
    outcomes: tuple[Outcome, ...] = described("how a trial can end")
    success: tuple[Outcome, ...] = described("the outcomes that may earn a reward")
    needs: tuple[str, ...] = described("further keys that the answer to a success must have")


class Answer(HandWritten):
    """The answer to a question. Unknown keys are refused; there is no reward, because the task scores."""

    adaptsim: int = Field(default=VERSION, description="version of question and answer")
    trial: int = described("number of the trial, as asked")
    context: dict[str, float] | None = Field(default=None, description="measured context in `units`, to `place`")
    t_s: Numbers | None = Field(
        default=None, description="times of the states, from the start of the motion, increasing"
    )
    state: tuple[Numbers, ...] | None = Field(
        default=None, description="the object's state at each time: one row per time"
    )
    end: Numbers | None = Field(default=None, description="instead of a trajectory: the object's state once it rests")
    rest_s: float | None = Field(default=None, ge=0.0, description="when the object came to rest; null: not measured")
    end_in_tool_m: tuple[float, float, float] | None = Field(
        default=None, description="last place of the object in the tool's frame, where the question `needs` it"
    )
    outcome: Outcome | None = Field(
        default=None,
        strict=False,
        description="how it ended, one of `outcomes`; optional if there is only one",
    )
    note: str = Field(default="", description="a sentence for the record")
    rejected: str | None = Field(default=None, description="why this attempt does not count; it is made again")
    impossible: str | None = Field(
        default=None, description="why this action cannot be done here; another one is chosen"
    )


EXCHANGES: dict[str, type[Record]] = {"own-robot question": Question, "own-robot answer": Answer}
"""The records of ask and tell, by the name under which `adaptsim schema` prints them."""
