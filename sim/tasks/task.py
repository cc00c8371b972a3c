"""The contract of a task: everything that differs between scooping, pushing and the pendulum.

Physics, planning and scoring of one task live in its folder; code that learns, stores or guides an operator takes a
`Task` and never asks which one it is.

A solver has two contracts, because a session may take policies and expectations from different solvers. A task with
exact answers brings its own solver (`Task.exact`). The others are in `sim.solvers`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.errors import NoHardware
from sim.types import PredictedOutcomes, Space

if TYPE_CHECKING:
    from sim.tasks.hardware import Hardware
    from sim.tasks.training import TrainedPolicies


@dataclass(frozen=True)
class AdaptationSettings:
    """Hyperparameters of the adaptation policy (paper, Table A1)."""

    horizon: int  # I, iterations of a session
    delta: float  # step, fraction of each parameter's range
    discount: float
    threshold: float  # sparse reward: R counts only if R >= threshold
    trials_per_iteration: int
    learning_rate: float
    trial_std: float = 0.4
    """Standard deviation of single trials around their expectation.

    The default is almost that of a coin, because most rewards of contact tasks are near 0 or near 1."""
    end_moments: int = 1
    """Number of the last moments of an observation, which are all that the state-only variants see."""


@dataclass(frozen=True)
class ReuseRules:
    """When NAF reuses a task policy: D, M, M_min, M_max and alpha of the paper (A2.2); budgets in rollouts.

    Raises ValueError if they contradict each other.
    """

    distance: float  # D, between means normalised by their ranges
    first_budget: int  # M
    least_budget: int  # M_min
    max_budget: int  # M_max
    discount: float  # alpha

    def __post_init__(self) -> None:
        if not 0 < self.least_budget <= self.first_budget <= self.max_budget:
            raise ValueError(
                f"budgets must be 0 < M_min <= M <= M_max, not {self.least_budget}, {self.first_budget}, "
                f"{self.max_budget} rollouts"
            )
        if not (self.distance >= 0.0 and 0.0 < self.discount < 1.0):
            raise ValueError(f"D = {self.distance:g} must not be negative, alpha = {self.discount:g} lies in (0, 1)")

    def scaled(self, factor: float) -> ReuseRules:
        """The same rules with all budgets times `factor`."""
        first, least, most = (
            max(1, round(factor * b)) for b in (self.first_budget, self.least_budget, self.max_budget)
        )
        return replace(self, first_budget=first, least_budget=least, max_budget=most)


@dataclass(frozen=True, eq=False)
class Observation:
    """The observation of one trial: the state at fixed times, normalised by fixed bounds."""

    times_s: Array  # (M,)
    columns: tuple[int, ...]  # which entries of ObjectTrack.state
    low: Array  # (len(columns),) maps to 0
    high: Array  # (len(columns),) maps to 1
    noise_mean: Array  # (len(columns),) added to simulated observations, in state units
    noise_std: Array  # (len(columns),)
    curves: tuple[str, ...] = ()
    """Names of the columns if they are drawn over time; empty: they are x and y on the table."""

    @property
    def size(self) -> int:
        """Number of values in an observation."""
        return len(self.times_s) * len(self.columns)

    def __call__(self, track: ObjectTrack) -> Array:
        """(size,) normalised, time-major: x(t0), y(t0), x(t1), ..."""
        return self.normalise(track.at(self.times_s)[:, list(self.columns)])

    def normalise(self, states: Array) -> Array:
        """(..., M, k) in state units -> (..., size)."""
        unit = (states - self.low) / (self.high - self.low)
        return unit.reshape(*states.shape[:-2], self.size)

    def denormalise(self, observation: Array) -> Array:
        """(..., size) -> (..., M, k) in state units."""
        shape = (*observation.shape[:-1], len(self.times_s), len(self.columns))
        return self.low + observation.reshape(shape) * (self.high - self.low)

    def with_noise(self, observation: Array, rng: np.random.Generator) -> Array:
        """(..., size) of a simulation -> the same with the camera's noise."""
        states = self.denormalise(observation)
        noise = self.noise_mean + self.noise_std * rng.standard_normal(states.shape)
        return self.normalise(states + noise)


@dataclass(frozen=True, eq=False)
class Mirror:
    """The left-right symmetry of a task: a trial mirrored at the plane y = 0 is another possible trial.

    Each array holds +1 for a value that stays, and -1 for one that changes its sign.
    """

    parameters: Array  # (p,)
    action: Array  # (a,)
    nuisance: Array  # (n,)
    observed: Array  # (len(columns),) of the observation, in state units
    end_state: Array  # (k,)

    def keeps(self, parameters: Space) -> bool:
        """Whether the mirror images of a box of parameters fill the same box."""
        turned = self.parameters < 0.0
        return bool(np.allclose(parameters.low[turned], -parameters.high[turned]))


class Simulate(Protocol):
    """One training rollout, without arm or camera."""

    def __call__(
        self, parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Any = None
    ) -> ObjectTrack:
        """All in units, unnormalised: parameters (p,), context (c,), executed action (a,), nuisance (n,).

        Deterministic. Parameters may lie outside their ranges. `unmodelled` (an instance of `Task.unmodelled`) adds
        effects of a lab's world; None in training. A solver that does not converge gives a track with outcome
        SOLVER_FAILED and the reason in `flags`, never an exception.
        """


SimulateMany = Callable[[Array, Array, Array, Array], Sequence[ObjectTrack]]
"""Many rollouts at once, for a task that is cheaper in stacks: (N, p), (N, c), (N, a), (N, n) -> N tracks. Each track
is the same as that of `Simulate`."""


@dataclass(frozen=True)
class LabReport:
    """The report of a trial by a lab with a robot of its own (docs/guide/own-robot.md)."""

    columns: tuple[str, ...]  # of `ObjectTrack.state`, each with its unit: "x [m]"
    outcomes: tuple[Outcome, ...]  # how a trial can end
    successes: tuple[Outcome, ...]  # which of them are successes
    ends_in_tool: bool = False  # the end of a success is that of the object in the tool's frame, `end_in_tool_m`
    places_first: bool = False  # the context is where the object lies: measured, then the action is chosen
    computed: tuple[str, ...] = ()  # columns that only the simulation can compute, so that no lab can report them


@dataclass(frozen=True)
class TaskFile:
    """The file that declares a task, and its content."""

    path: str  # absolute
    sha256: str


@dataclass(frozen=True, eq=False)
class Task:
    """Everything that is specific to one task. Without `hardware` its trials need neither arm nor camera."""

    name: str
    title: str
    parameters: Space  # Omega
    margin: Space  # Omega and a margin around it; datasets are drawn from it
    context: Space  # may be empty
    action: Space
    nuisance: Space  # values that vary from trial to trial and that nobody chooses (may be empty)
    action_noise: Array  # (a,) half-width of the uniform error of executed actions
    observation: Observation
    adaptation: AdaptationSettings
    unmodelled: type[Any]  # frozen dataclass of a world's unmodelled effects; all have defaults
    simulate: Simulate
    reference_context: Array  # (c,) context of all datasets where others differ from it only by `relocate`
    succeeded: Callable[[ObjectTrack], bool]
    end_state: Callable[[ObjectTrack], Array]  # (k,) quantities that decide the reward of a success
    reward_of_success: Callable[[Array, Array], Array]  # end_state (..., k), context (..., c) -> (...)
    object_name: str  # its name for a person, e.g. "piece of food"
    reward_of_failure: Callable[[ObjectTrack], float] | None = None
    """Partial credit in [0, 1] for a failure, the same in every context; None if a failure earns nothing."""
    relocate: Callable[[Array, Array], Array] | None = None
    """Observation (..., size) at the reference context, context (..., c) -> the observation there. None: the context
    changes the motion itself, so it is an input of every rollout, as the parameters are (`physical_context`)."""
    simulate_many: SimulateMany | None = None  # None: one by one, on an executor
    reuse: ReuseRules | None = None  # rules of NAF policies (Table A1); None: no NAF
    mirror: Mirror | None = None
    """With it, an emulator learns from every rollout twice, once mirrored. None if there is no such symmetry."""
    exact: Callable[[Task], Solver] | None = None
    """Makes the exact solver of a task; None: an emulator is learnt from a dataset."""
    goal_m: Callable[[Array], Array] | None = None
    """Context (c,) -> wanted final place of the object on the table, (2,) m; None if the context is its first place."""
    plausible: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)
    """The plausible range of each unmodelled effect, from which worlds are drawn."""
    training: TrainedPolicies | None = None
    """How it trains policies (`sim.tasks.library`). Then its `simulate` takes a policy as the action, and `action`
    names the parameters for which a policy was trained. None if actions are numbers."""
    hardware: Hardware | None = None  # None: it runs in simulation only
    report: LabReport | None = None  # None: no robot of one's own can run it
    scene: Any = None
    """The effects of an own object that its scene always has (`sim.tasks.own_object`); None: the task's scene."""
    worlds: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Worlds that the task declares itself: name -> tables of a world's file."""
    physics: str = "drake"  # the simulator behind `simulate`, for a person
    file: TaskFile | None = None  # that declares it; None: a module of ours, or of an installed package
    scene_files: tuple[str, ...] = ()  # further files that its physics is made of
    outcome_in_words: Callable[[ObjectTrack], str] | None = None
    """The end of a trial in the task's own words; None: those of its outcome."""

    def __post_init__(self) -> None:
        if self.relocate is None and len(self.context) and self.mirror is not None:
            raise ValueError(
                f"the task {self.name} has a mirror, which does not say how its context is mirrored, and no relocate: "
                "leave one of the two out"
            )

    @property
    def physical_context(self) -> Space:
        """The quantities of the context that a rollout depends on: all of them, or none with `relocate`.

        This, `simulated_in` and `at_context` alone decide whether learning treats a context as an input.
        """
        return self.context if self.relocate is None else Space(())

    def simulated_in(self, context: Array | None) -> Array:
        """(..., c) -> (..., c): the context in which the rollouts of a trial are simulated; see `at_context`.

        None: the reference context (c,). Raises ValueError if the context moves things, so that there is none.
        """
        if context is None:
            if len(self.physical_context):
                raise ValueError(f"a trial of {self.name} depends on its context, and none was given")
            return np.asarray(self.reference_context, dtype=np.float64)
        if self.relocate is None:
            return np.asarray(context, dtype=np.float64)
        reference = np.asarray(self.reference_context, dtype=np.float64)
        return np.broadcast_to(reference, (*np.shape(context)[:-1], len(reference)))

    def at_context(self, observation: Array, context: Array | None) -> Array:
        """(..., size) simulated in `simulated_in(context)`, context (..., c) -> the observation in that context."""
        return observation if self.relocate is None or context is None else self.relocate(observation, context)

    def require_hardware(self) -> Hardware:
        """The parts for an arm. Raises NoHardware for a task that runs in simulation only."""
        if self.hardware is None:
            raise NoHardware(f"the task {self.name} has no motion for a robot arm; it runs in simulation only")
        return self.hardware

    def require_report(self) -> LabReport:
        """The report that a lab makes of its trials. Raises NoHardware for a task that no lab can report."""
        if self.report is None:
            raise NoHardware(
                f"the task {self.name} does not say what a lab reports of a trial, so no robot of yours can run it: "
                "declare Task.report (docs/guide/add-a-task.md)"
            )
        if self.report.computed:
            raise NoHardware(
                f"the task {self.name} does not fit a robot of your own: its reward needs "
                f"{', '.join(self.report.computed)}, which only its simulation computes"
            )
        return self.report

    def score(self, track: ObjectTrack, context: Array) -> float:
        """Reward of one trial in [0, 1]."""
        end = self.end_of(track)
        return self.failure_reward(track) if end is None else float(self.reward_of_success(end, context))

    def failure_reward(self, track: ObjectTrack) -> float:
        """Reward of a failure in [0, 1]. A rollout that the solver could not finish earns nothing."""
        if self.reward_of_failure is None or track.outcome is Outcome.SOLVER_FAILED:
            return 0.0
        return float(self.reward_of_failure(track))

    def expected_reward(self, predicted: PredictedOutcomes, context: Array) -> Array:
        """(...) expected rewards of trials in contexts (..., c)."""
        earned = np.asarray(predicted.success * self.reward_of_success(predicted.end_state, context))
        if predicted.failure_reward is None:
            return earned
        return np.asarray(earned + (1.0 - predicted.success) * predicted.failure_reward)

    def end_of(self, track: ObjectTrack) -> Array | None:
        """The end state (k,) of a success; None for a failure."""
        return self.end_state(track) if self.succeeded(track) else None


Executable = Callable[[Array, Array], bool]
"""(context (c,), action (a,)) in units -> whether the arm can do it within its limits."""


@dataclass(frozen=True)
class SolverSettings:
    """The resolution and caution of a solver's search."""

    candidates: int = 256
    scenarios: int = 16  # draws of parameters, nuisance and action error per action
    refine: int = 32  # points around the best action; 0: none
    kappa: float = 0.5  # the reward is mean - kappa * standard deviation of the ensemble
    attempts: int = 64  # candidates offered to the executability check before giving up


class SolvedPolicy(Protocol):
    """A task policy for one distribution of parameters, with its predicted reward."""

    def __call__(self, context: Array) -> Array:
        """(c,) in units -> (a,) in units. Raises NotExecutable if no good action can be executed."""

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a), without the executability check: for training in simulation."""

    def predict(self, context: Array) -> tuple[float, float, float]:
        """Predicted reward of this policy at `context` if its parameters are true: mean, and both ends of its 95 %
        interval.
        """


class Policies(Protocol):
    """Task policies of one task. Parameters, contexts and actions are in units."""

    @property
    def task(self) -> Task:
        """The task of the policies."""

    def policies(
        self,
        samples: Array,
        rng: np.random.Generator,
        executable: Executable | None = None,
        settings: SolverSettings | None = None,
    ) -> tuple[SolvedPolicy, ...]:
        """One policy for each of B distributions, given as samples (B, m, p); the same draws for all."""


class Expectations(Protocol):
    """Expectations of trials in the simulator of one task. Parameters, contexts and actions are in units."""

    @property
    def task(self) -> Task:
        """The task of the trials."""

    def expected_rewards(
        self, targets: Array, contexts: Array, actions: Array, rng: np.random.Generator, draws: int = 16
    ) -> Array:
        """(B,) rewards in targets (B, p) of actions (B, G, a) at contexts (G, c) or (B, G, c), averaged over everything
        but B.
        """

    def trial_rewards(self, parameters: Array, contexts: Array, action: Array, nuisance: Array) -> Array:
        """(N,) expected rewards of N executed trials: (N, p), (N, c), (N, a), (N, n)."""

    def trajectories(self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None) -> Array:
        """(N, size) expected observations of N trials, without camera noise: (N, p), (N, a), (N, n), (N, c).

        Without a context they are those at the task's reference context. Raises ValueError if it moves things.
        """

    def outcomes(
        self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None
    ) -> PredictedOutcomes:
        """(..., p), (..., a), (..., n), (..., c), broadcast -> chance of success (M, ...), end state of a success
        (M, ..., k), reward of a failure (M, ...); for the context see `trajectories`.

        M is the size of the ensemble, or 1.
        """

    @property
    def residual_std(self) -> Array:
        """(size,) spread of the errors of `trajectories`, normalised."""

    @property
    def misfit_limit(self) -> float:
        """The misfit (see `sim.solvers.misfit`) that 95 % of simulated trials inside the ranges do not exceed."""


class Solver(Policies, Expectations, Protocol):
    """Policies and expectations at once, as pretraining needs them."""
