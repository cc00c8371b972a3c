"""The loop of a session, the same wherever its trials happen. Read from the top.

`iterate` asks the session for the next missing stage, does it, and yields it: a trial, the adaptation, or the end of an
iteration. The code that takes the stages decides when the session ends, and what else happens after a stage. A stored
session (`adaptsim_cli.session.flow`) keeps every stage on the disk before the next one begins. A `MemorySession`
forgets all at its end: the benchmark and the evaluation of a pretraining need no more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import Protocol

import numpy as np

from sim.adaptation.adaptation import Adaptation
from sim.adaptation.method import Iteration, Particle, ParticleTrials, Trial
from sim.adaptation.stages import Adapt, Existing, Layout, RunTrial, Show, Stage, TrialKey, next_stage
from sim.tasks.task import SolvedPolicy

Progress = Callable[[str, str], AbstractContextManager[None]]
"""Shows the operator a sentence about a running step, and adds its time to that of a stage."""

PolicySource = Callable[[], SolvedPolicy]
"""The task policy of a trial, which is trained on the first call. A trial that continues from its recording needs no
policy."""

Policies = dict[tuple[int, int], SolvedPolicy]
"""(iteration, particle) -> its task policy; only those of the newest iteration."""


@contextmanager
def silently(what: str, stage: str) -> Iterator[None]:
    """A `Progress` that says nothing."""
    yield


class PlayableSession(Protocol):
    """A session as the loop sees it; on the disk or in memory. Iterations and particles count from 0."""

    @property
    def adaptation(self) -> Adaptation:
        """The adapting part of the session."""

    @property
    def policies(self) -> Policies:
        """The task policies that were trained in this process."""

    @property
    def progress(self) -> Progress:
        """Is told of each step."""

    def next_stage(self) -> Stage:
        """The next missing stage."""

    def particles(self, iteration: int) -> tuple[Particle, ...]:
        """The particles of an iteration."""

    def history(self, iterations: int) -> tuple[Iteration, ...]:
        """The trials that count of the first `iterations`."""

    def generator(self, iteration: int) -> np.random.Generator:
        """The random numbers of the adaptation after an iteration."""

    def play_trial(self, stage: RunTrial, policy: PolicySource) -> None:
        """Run a trial and keep it, or keep why it does not count; then the next stage is its next attempt."""

    def keep_particles(self, stage: Adapt, history: Sequence[Iteration], particles: tuple[Particle, ...]) -> None:
        """Keep the particles of the next iteration, chosen after `history`."""

    def mark_shown(self, iteration: int) -> None:
        """Note that the operator has seen a complete iteration; a repeated call changes nothing."""


def iterate(session: PlayableSession) -> Iterator[Stage]:
    """Do one missing stage after the other, and yield each once it is done; there is always a next one.

    A complete iteration is yielded as `Show`. It counts as shown once the stage after it is asked for, so a session
    that ends before that yields it again. Raises the errors of trials.
    """
    while True:
        match stage := session.next_stage():
            case RunTrial():
                session.play_trial(stage, partial(policy_of_particle, session, stage.iteration, stage.particle))
            case Adapt():
                history = session.history(stage.iteration + 1)
                with session.progress("Adapting the simulation parameters", "adapting"):
                    particles = session.adaptation.next(history, session.generator(stage.iteration))
                session.keep_particles(stage, history, particles)
        yield stage
        if isinstance(stage, Show):
            session.mark_shown(stage.iteration)


def policy_of_particle(session: PlayableSession, iteration: int, index: int) -> SolvedPolicy:
    """The task policy of a particle. If an earlier process trained it, training again gives the same policy."""
    if (iteration, index) not in session.policies:
        train(session, iteration, index, session.particles(iteration)[index], session.history(iteration))
    return session.policies[iteration, index]


def train(
    session: PlayableSession, iteration: int, index: int, particle: Particle, history: Sequence[Iteration]
) -> None:
    """Train the task policy of a particle, and forget those of earlier iterations."""
    with session.progress(f"Training the task policy of particle {index + 1}", "training"):
        for earlier in [key for key in session.policies if key[0] < iteration]:
            del session.policies[earlier]
        session.policies[iteration, index] = session.adaptation.train(particle, history)


PlayTogether = Callable[[SolvedPolicy, int, int], tuple[Trial, ...]]
"""(policy, iteration, particle) -> the particle's trials of an iteration, which may run at the same time."""


@dataclass
class MemorySession:
    """A `PlayableSession` that is not stored. All trials of a particle run together, because no operator acts between
    them.
    """

    adaptation: Adaptation
    play: PlayTogether
    generator: Callable[[int], np.random.Generator]
    steps: list[tuple[Particle, ...]]  # the particles of every iteration so far
    trials: int  # of a particle in an iteration
    progress: Progress = silently
    policies: Policies = field(default_factory=dict)
    played: list[tuple[Trial, ...]] = field(default_factory=list)  # particle by particle, iteration by iteration
    shown: set[int] = field(default_factory=set)  # complete iterations

    def next_stage(self) -> Stage:
        """See `PlayableSession`."""
        layout, completed = Layout(len(self.steps[0]), self.trials), len(self.played) * self.trials
        results = {i: tuple(TrialKey(number, 0) for number in layout.numbers(i)) for i in range(len(self.steps) - 1)}
        keys = frozenset(TrialKey(number, 0) for number in range(1, completed + 1))
        nothing = frozenset[TrialKey]()
        existing = Existing(keys, nothing, nothing, nothing, results, frozenset(self.shown))
        return next_stage(existing, layout)

    def particles(self, iteration: int) -> tuple[Particle, ...]:
        """See `PlayableSession`."""
        return self.steps[iteration]

    def history(self, iterations: int) -> tuple[Iteration, ...]:
        """See `PlayableSession`."""
        each = len(self.steps[0])
        return tuple(
            tuple(map(ParticleTrials, self.steps[i], self.played[i * each : (i + 1) * each])) for i in range(iterations)
        )

    def play_trial(self, stage: RunTrial, policy: PolicySource) -> None:
        """See `PlayableSession`. All other trials of the particle are played at the same time."""
        self.played.append(self.play(policy(), stage.iteration, stage.particle))

    def keep_particles(self, stage: Adapt, history: Sequence[Iteration], particles: tuple[Particle, ...]) -> None:
        """See `PlayableSession`."""
        self.steps.append(particles)

    def mark_shown(self, iteration: int) -> None:
        """See `PlayableSession`."""
        self.shown.add(iteration)

    def iterations(self, count: int) -> Iterator[tuple[Iteration, ...]]:
        """Play `count` iterations, and return the history after each."""
        complete = (stage.iteration for stage in iterate(self) if isinstance(stage, Show))
        for iteration in islice(complete, count):
            self.mark_shown(iteration)
            yield self.history(iteration + 1)


def begin_in_memory(
    adaptation: Adaptation,
    play: PlayTogether,
    shape: tuple[int, int],
    start: np.random.Generator,
    generator: Callable[[int], np.random.Generator],
) -> MemorySession:
    """A session in memory; `shape` is (particles, trials of each in an iteration)."""
    particles, trials = shape
    return MemorySession(adaptation, play, generator, [adaptation.start(particles, start)], trials)
