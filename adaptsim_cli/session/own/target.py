"""A robot of one's own as a `Target`: every step is a question, and its answer a file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from adaptsim_cli.errors import AnswerRefused
from adaptsim_cli.screen.outputs.exchange import Answer, PolicyFile, Question
from adaptsim_cli.screen.outputs.trials import TrackRecord, as_row, named
from adaptsim_cli.screen.release import Release
from adaptsim_cli.screen.views import Readiness, value_in_words
from adaptsim_cli.session.folders import QUESTIONS
from adaptsim_cli.session.live_trial import PlacedTrial, PlannedTrial
from adaptsim_cli.session.operator import Operator
from adaptsim_cli.session.own.exchange import Answerer, Exchange
from adaptsim_cli.session.own.reading import action_of, measured_context, track_of
from adaptsim_cli.session.records import read
from adaptsim_cli.session.simulated_target import FILE, KnownMotion
from hw.types import Array
from perception.errors import TrackingFailed
from perception.types import ObjectTrack, Outcome
from sim.adaptation.methods import kind_of
from sim.adaptation.sessions import Progress, silently
from sim.adaptation.stages import RunTrial, TrialKey
from sim.errors import ActionImpossible, MomentsMissing, RecordingsRefused
from sim.rollouts.recorded import RecordedTrials, copied, frame_aside, start_offset_m
from sim.solvers.misfit import observed_share
from sim.solvers.readings import table_doubt, trial_doubt
from sim.tasks.library import library_of, main_file
from sim.tasks.task import Expectations, Task
from sim.types import Space

NEAR = 0.05
"""An action counts as impossible if one was impossible that differs by at most this share of each range, in a context
as near."""
COMPARED_AT = (4, 8, 16)
"""Numbers of answers after which all of them are compared with the simulator under other readings."""


@dataclass(frozen=True)
class OwnTarget:
    """A `Target` whose robot, camera and code belong to the lab."""

    task: Task
    session: Path  # folder of the session
    answerer: Answerer
    method: str
    expectations: Expectations | None = None  # of the session's simulator; None: answers are not compared with it
    _impossible: list[tuple[Array, Array]] = field(default_factory=list)  # (context, action), normalised

    @classmethod
    def of_session(
        cls, task: Task, session: Path, answerer: Answerer, method: str, expectations: Expectations | None = None
    ) -> OwnTarget:
        """The target of a session, with the actions that its robot could not do before."""
        target = cls(task, session, answerer, method, expectations)
        for file in sorted((session / QUESTIONS).glob("*/trial.answer.json")):
            exchange = Exchange(file.parent, "trial")
            try:
                answer, question = exchange.answer(), exchange.question()
            except (AnswerRefused, OSError, ValueError):
                continue
            if answer is not None and answer.impossible and question.action is not None:
                target._note_impossible(question)
        return target

    @property
    def title(self) -> str:
        """See `Target`."""
        return f"your robot, {self.answerer.title}"

    @property
    def moves(self) -> bool:
        """See `Target`."""
        return self.answerer.moves

    @property
    def needs_consent(self) -> bool:
        """See `Target`."""
        return self.answerer.needs_consent

    @property
    def release(self) -> Release:
        """See `Target`."""
        return self.answerer.release

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """See `Target`: those of the task."""
        return self.task.require_report().outcomes

    def checks(self) -> tuple[Readiness, ...]:
        """See `Target`: adaptsim checks nothing of this robot."""
        return (Readiness("your robot", True, f"{self.answerer.title}; adaptsim checks none of its motion"),)

    def goes_on(self, key: TrialKey) -> bool:
        """See `Target`. Once the question is asked, it is not asked again, and its answer is used."""
        return self._exchange(key, "trial").question_file.exists()

    def spent(self, stage: RunTrial, operator: Operator) -> bool:
        """See `Target`. It never is, because nothing moves before the question is asked."""
        return False

    def place(self, drawn: Array, key: TrialKey, operator: Operator, progress: Progress = silently) -> PlacedTrial:
        """See `Target`: asks for the measured context, if the task needs it.

        Raises AnswerAwaited, AnswerRefused.
        """
        if not self.task.require_report().places_first:
            return PlacedTrial(drawn, drawn, key)
        question = self._question("place", key, drawn, None)
        answer = self._answer(question, key, progress)
        if answer.rejected or answer.impossible:
            raise TrackingFailed(f"your robot's answer: {answer.rejected or answer.impossible}")
        with _explained(self._exchange(key, "place")):
            return PlacedTrial(drawn, measured_context(answer, question, self.task), key)

    def executable(self, context: Array, action: Array) -> bool:
        """Whether the action may be possible: no answer so far says that such an action is impossible."""
        here = self._normalised(context, action)
        return not any(
            np.abs(here[0] - other[0]).max(initial=0.0) <= NEAR and np.abs(here[1] - other[1]).max() <= NEAR
            for other in self._impossible
        )

    def plan(self, placed: PlacedTrial, action: Array, progress: Progress = silently) -> PlannedTrial:
        """See `Target`: only the robot's own code knows whether the action can be done."""
        who = self.answerer
        return PlannedTrial(
            placed.drawn,
            placed.context,
            placed.key,
            action,
            summary="Your robot makes this trial",
            announcement=who.announcement,
            then=who.then,
            digest=self._exchange(placed.key, "trial").digest,
        )

    def execute(self, planned: PlannedTrial, progress: Progress = silently) -> KnownMotion:
        """See `Target`: ask for the trial. Raises AnswerAwaited, AnswerRefused, ActionImpossible, TrackingFailed."""
        key = planned.key
        question = self._question("trial", key, planned.context, planned.action)
        answer = self._answer(question, key, progress)
        if answer.impossible:
            self._note_impossible(question)
            raise ActionImpossible(f"your robot cannot do this action: {answer.impossible}")
        if answer.rejected:
            raise TrackingFailed(f"your robot's answer rejects it: {answer.rejected}")
        exchange = self._exchange(key, "trial")
        with _explained(exchange):
            track = track_of(answer, question, self.task)
            track = replace(track, flags=(*track.flags, *self._doubts(track, question)))
            if kind_of(self.method).needs_whole and observed_share(self.task.observation(track)) < 1.0:
                raise MomentsMissing(
                    f"{self.method} needs every moment of a trial, and this answer misses some: report the whole "
                    "trajectory, or begin another session with --method adaptsim"
                )
        files = {file.name: file.read_bytes() for file in (exchange.question_file, exchange.answer_file)}
        return KnownMotion(track, others=files)

    def _doubts(self, track: ObjectTrack, question: Question) -> tuple[str, ...]:
        """A sentence about a mistake of this trial, or of this and earlier trials together, which contradict their
        actions.
        """
        task, answers = self.task, [(track, question)]
        for file in sorted((self.session / QUESTIONS).glob("*/trial.answer.json")):
            exchange = Exchange(file.parent, "trial")
            with suppress(AnswerRefused, OSError, ValueError):
                earlier, its_question = exchange.answer(), exchange.question()
                if earlier is not None and its_question.trial < question.trial and earlier.t_s is not None:
                    answers.append((track_of(earlier, its_question, task), its_question))
        self._require_new(answers)
        pairs = [(one, _context_of(its_question, task)) for one, its_question in answers]
        if aside := frame_aside([start_offset_m(task, one, context) for one, context in pairs]):
            return (aside,)
        if self.expectations is None:
            return ()
        checks = [(answers[:1], trial_doubt, "this answer contradicts its action")]
        if len(answers) in COMPARED_AT:
            checks.insert(0, (answers, table_doubt, "so far the answers contradict their actions"))
        for some, check, words in checks:
            with suppress(RecordingsRefused):
                if sentence := check(self.expectations, self._as_table(some)):
                    return (f"{words}: {sentence}",)
        return ()

    def _as_table(self, answers: Sequence[tuple[ObjectTrack, Question]]) -> RecordedTrials:
        """The answers as recorded trials, without those that repeat an action. Raises RecordingsRefused."""
        rows = list(
            {action_of(question, self.task).tobytes(): (track, question) for track, question in answers}.values()
        )
        return RecordedTrials(
            self.task,
            tuple(f"{question.trial}" for _, question in rows),
            np.array([_context_of(question, self.task) for _, question in rows]),
            np.array([action_of(question, self.task) for _, question in rows]),
            tuple(track for track, _ in rows),
        )

    def _require_new(self, answers: Sequence[tuple[ObjectTrack, Question]]) -> None:
        """Raises AnswerRefused if the first answer has the trajectory of another one, although their actions differ."""
        question = answers[0][1]
        for track, earlier in answers[1:]:
            names = (f"{earlier.trial}", f"{question.trial}")
            if earlier.action != question.action and copied(self.task, names, (track, answers[0][0])):
                raise AnswerRefused(
                    f"it has the trajectory of trial {earlier.trial}, but its action differs: is this an old answer, "
                    "or did the robot limit both actions alike? Then reject the trial"
                )

    def read(self, folder: Path, context: Array, action: Array) -> KnownMotion:
        """See `Target`: the trajectory."""
        return KnownMotion(read(TrackRecord, folder / FILE).track())

    def _exchange(self, key: TrialKey, ask: str) -> Exchange:
        return Exchange.of(self.session / QUESTIONS, key, ask)

    def _question(self, ask: str, key: TrialKey, context: Array, action: Array | None) -> Question:
        task, report = self.task, self.task.require_report()
        spaces = (task.context, task.action)
        return Question(
            ask="place" if ask == "place" else "trial",
            session=self.session.name,
            task=task.name,
            trial=key.number,
            attempt=key.attempt + 1,
            context=named(task.context.names, context),
            action=None if action is None else named(task.action.names, action),
            policy=None if action is None else _policy_of(task, action),
            goal_m=None if task.goal_m is None else as_row(task.goal_m(context)),
            units={d.name: d.unit for space in spaces for d in space.dimensions},
            words={**in_words(task.context, context), **({} if action is None else in_words(task.action, action))},
            times_s=as_row(task.observation.times_s),
            state=report.columns,
            outcomes=report.outcomes,
            success=report.successes,
            needs=("end_in_tool_m",) if report.ends_in_tool else (),
        )

    def _answer(self, question: Question, key: TrialKey, progress: Progress) -> Answer:
        """The answer that counts; it is asked for if there is none yet. Raises AnswerAwaited, AnswerRefused."""
        exchange = self._exchange(key, question.ask)
        exchange.pose(question)
        with _explained(exchange):
            answer = exchange.answer()
        if answer is None:
            self.answerer.ask(exchange, question, progress)
            with _explained(exchange):
                answer = exchange.answer()
        if answer is None:
            raise AnswerRefused(f"trial {key.number} has no answer: {exchange.answer_file} is missing")
        return answer

    def _normalised(self, context: Array, action: Array) -> tuple[Array, Array]:
        return self.task.context.normalise(context), self.task.action.normalise(action)

    def _note_impossible(self, question: Question) -> None:
        self._impossible.append(self._normalised(_context_of(question, self.task), action_of(question, self.task)))


def _context_of(question: Question, task: Task) -> Array:
    """(c,) the context of a trial, in units."""
    return np.array([question.context[name] for name in task.context.names])


def _policy_of(task: Task, action: Array) -> PolicyFile | None:
    library = library_of(task)
    if library is None:
        return None
    member = library.nearest(task, action)
    return PolicyFile(name=member.name, file=str(main_file(member).absolute()))


@contextmanager
def _explained(exchange: Exchange) -> Iterator[None]:
    """Adds to a refused answer its file and the next step."""
    try:
        yield
    except (AnswerRefused, MomentsMissing) as error:
        stop = "" if str(error).endswith("?") else "."
        raise AnswerRefused(
            f"the answer to trial {exchange.question().trial} does not count: {error}{stop} It is kept in "
            f"{exchange.answer_file}: correct it there, or delete it to be asked again"
        ) from error


def in_words(space: Space, values: Array) -> dict[str, str]:
    """The categories among the values (n,) of a space, by name, in words."""
    return {
        d.name: value_in_words(d, float(value)) for d, value in zip(space.dimensions, values, strict=True) if d.words
    }
