"""The emulator: parameters, action, nuisance and a context that moves things -> trajectory, outcome, and their
uncertainty.

An ensemble of small networks, evaluated as one batched product, so that thousands of inputs take
milliseconds. Each member carries a fixed random network beside the trained one (a randomised prior, Osband et
al. 2018): near data the trained part cancels it, elsewhere the members disagree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.errors import CheckpointError
from sim.solvers.candidates import FromOutcomes, ScenarioPolicy, search
from sim.solvers.threads import one_blas_thread
from sim.storage.files import Tensors
from sim.tasks.task import Executable, SolverSettings, Task
from sim.types import PredictedOutcomes, Space

ROWS = 512
"""Inputs evaluated at once, few enough for the layers' outputs to stay in the processor's cache."""

Array32 = NDArray[np.float32]

PRIOR_SCALE = 0.5
"""Weight of the fixed random networks, in standard deviations of the outputs."""

SELF_TEST = "self_test"
INPUTS, SEED = 4, 1908
TOLERANCE = 1e-3
"""Between processors, float32 differs by 1e-6; a changed weight by more."""


def inputs(task: Task) -> tuple[Space, ...]:
    """The spaces whose quantities are the emulator's inputs, in their order."""
    return task.margin, task.action, task.nuisance, task.physical_context


def encode(task: Task, parameters: Array, context: Array, action: Array, nuisance: Array) -> Array32:
    """(..., p), (..., c), (..., a), (..., n) in units -> (..., f): each in about [-1, 1], whole numbers one-hot.

    The leading shapes broadcast.
    """
    values = (parameters, action, nuisance, context[..., : len(task.physical_context)])
    lead = np.broadcast_shapes(*(value.shape[:-1] for value in values))
    columns = [_encode_space(space, value) for space, value in zip(inputs(task), values, strict=True)]
    return np.concatenate([np.broadcast_to(c, (*lead, c.shape[-1])) for c in columns], axis=-1)


def _encode_space(space: Space, value: Array) -> Array32:
    unit = 2.0 * space.normalise(value) - 1.0
    columns: list[Array] = []
    for i, d in enumerate(space.dimensions):
        if d.scale == "integer":
            # A triangle around each level: one-hot at integers, interpolated for the mean of a distribution.
            levels = np.arange(d.low, d.high + 1.0)
            columns.append(np.clip(1.0 - np.abs(value[..., i, None] - levels), 0.0, 1.0))
        else:
            columns.append(unit[..., i, None])
    stacked = np.concatenate(columns, axis=-1) if columns else np.zeros((*value.shape[:-1], 0))
    return stacked.astype(np.float32)


@dataclass(frozen=True, eq=False)
class EmulatedTrials:
    """The emulator's predictions, in the contexts in which rollouts are simulated (`Task.simulated_in`)."""

    observation: Array  # (N, size) normalised, without camera noise
    success: Array  # (N,) probability
    end_state: Array  # (N, k) if it succeeds
    failure_reward: Array | None  # (N,) if it fails; None: in this task it earns nothing


class Emulator(FromOutcomes):
    """A `sim.solvers.solver.Solver`: the trained networks of `sim.solvers.emulator.training`. Not for subclassing."""

    def __init__(self, task: Task, tensors: Tensors) -> None:
        """Raises CheckpointError if the tensors are not those of an emulator of this task."""
        self.task = task
        self._tensors = {name: tensors[name].copy() for name in sorted(tensors)}
        missing = {"depth", "y_mean", "y_std", "temperature", "residual_std", "misfit_limit", "w0"} - tensors.keys()
        if missing:
            raise CheckpointError(f"the emulator has no {', '.join(sorted(missing))}: pretrain again")
        spaces = (task.margin, task.context, task.action, task.nuisance)
        features = encode(task, *(np.zeros((1, len(s))) for s in spaces)).shape[-1]
        if tensors["w0"].shape[1] != features:
            raise CheckpointError(
                f"an emulator of {tensors['w0'].shape[1]} inputs does not fit {task.name}, which has {features}: "
                "pretrain again"
            )
        self._depth = int(tensors["depth"])

    @property
    def tensors(self) -> dict[str, NDArray[Any]]:
        """The tensors to store; `Emulator(task, tensors)` restores the emulator."""
        return dict(self._tensors)

    def _parts(self, raw: Array) -> tuple[Array, Array, Array | None]:
        """Outputs (..., k [+ 1] + 1) after the observation -> success (...), end state (..., k), reward of a failure
        (...).
        """
        success = self._probability(raw[..., -1])
        if self.task.reward_of_failure is None:
            return success, raw[..., :-1], None
        return success, raw[..., :-2], np.clip(raw[..., -2], 0.0, 1.0)

    @property
    def members(self) -> int:
        """Number of networks in the ensemble."""
        return int(self._tensors["w0"].shape[0])

    @property
    def residual_std(self) -> Array:
        """(size,) robust spread of the held-out errors of the observation, normalised."""
        return np.asarray(self._tensors["residual_std"], dtype=np.float64)

    @property
    def misfit_limit(self) -> float:
        """The misfit that 95 % of held-out rollouts inside the ranges do not exceed (see `sim.solvers.misfit`)."""
        return float(self._tensors["misfit_limit"])

    def predict(self, parameters: Array, context: Array, action: Array, nuisance: Array) -> EmulatedTrials:
        """(N, p), (N, c), (N, a), (N, n) in units -> predictions."""
        size = self.task.observation.size
        raw = self._forward(encode(self.task, parameters, context, action, nuisance), slice(None))
        mean = PredictedOutcomes(*self._parts(raw[..., size:])).mean_of_ensemble
        return EmulatedTrials(raw[..., :size].mean(axis=0), mean.success, mean.end_state, mean.failure_reward)

    def policies(
        self,
        samples: Array,
        rng: np.random.Generator,
        executable: Executable | None = None,
        settings: SolverSettings | None = None,
    ) -> tuple[ScenarioPolicy, ...]:
        """One policy for each of B distributions, samples (B, m, p) in units; the same draws for all."""
        return search(self, samples, rng, executable, settings)

    def trajectories(self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None) -> Array:
        """(N, size), the mean of the ensemble."""
        simulated = self.predict(parameters, self.task.simulated_in(context), action, nuisance).observation
        return self.task.at_context(simulated, context)

    def outcomes(
        self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None
    ) -> PredictedOutcomes:
        """The outcomes predicted by every member, (M, ...); see `sim.tasks.task.Expectations`."""
        features = encode(self.task, parameters, self.task.simulated_in(context), action, nuisance)
        lead = features.shape[:-1]
        raw = self._forward(features.reshape(-1, features.shape[-1]), slice(self.task.observation.size, None))
        return PredictedOutcomes(*self._parts(raw.reshape(self.members, *lead, raw.shape[-1])))

    def draw(
        self, parameters: Array, context: Array, action: Array, nuisance: Array, rng: np.random.Generator
    ) -> EmulatedTrials:
        """One random outcome for each of (N, p), (N, c), (N, a), (N, n): the prediction of one member plus a residual
        error.

        `success` is 0 or 1.
        """
        size, n = self.task.observation.size, len(parameters)
        member = rng.integers(self.members, size=n)
        features = encode(self.task, parameters, context, action, nuisance)
        raw = self._forward(features, slice(None))[member, np.arange(n)]
        observation = raw[:, :size] + rng.standard_normal((n, size)) * self.residual_std
        success, end, failed = self._parts(raw[:, size:])
        return EmulatedTrials(observation, (rng.random(n) < success).astype(np.float64), end, failed)

    def _probability(self, logit: Array) -> Array:
        scaled = np.clip(logit / float(self._tensors["temperature"]), -30.0, 30.0)
        return np.asarray(1.0 / (1.0 + np.exp(-scaled)), dtype=np.float64)

    def _forward(self, features: Array32, outputs: slice) -> Array:
        """(N, f) -> (M, N, outputs) in the units of the targets."""
        scale, shift = self._tensors["y_std"][outputs], self._tensors["y_mean"][outputs]
        raw = np.empty((self.members, len(features), len(scale)))
        with one_blas_thread():
            for first in range(0, len(features), ROWS):
                rows = slice(first, first + ROWS)
                raw[:, rows] = self._standardised(features[rows], outputs) * scale + shift
        return raw

    def _standardised(self, x: Array32, outputs: slice) -> Array32:
        """(N, f) -> (M, N, outputs): the trained networks and their fixed priors."""
        trained, prior = self._network("w", "b", self._depth, x, outputs), self._network("pw", "pb", 1, x, outputs)
        return trained + np.float32(PRIOR_SCALE) * prior

    def _network(self, w: str, b: str, depth: int, x: Array32, outputs: slice) -> Array32:
        for layer in range(depth):
            x = x @ self._tensors[f"{w}{layer}"]
            x += self._tensors[f"{b}{layer}"]
            np.maximum(x, 0.0, out=x)
        last: Array32 = x @ self._tensors[f"{w}{depth}"][..., outputs] + self._tensors[f"{b}{depth}"][..., outputs]
        return last


def predictions(emulator: Emulator) -> list[float]:
    """The self-test: observation, success and end state predicted for a few drawn trials, one after another."""
    task, rng = emulator.task, np.random.default_rng(SEED)
    drawn = [space.denormalise(rng.uniform(0.0, 1.0, (INPUTS, len(space)))) for space in inputs(task)]
    parameters, action, nuisance, context = drawn
    try:
        prediction = emulator.predict(parameters, context, action, nuisance)
    except (ValueError, IndexError, KeyError) as error:
        raise CheckpointError(f"the emulator's weights do not fit one another ({error}): pretrain again") from error
    parts = (prediction.observation, prediction.success, prediction.end_state, prediction.failure_reward)
    return [round(float(value), 7) for part in parts if part is not None for value in np.ravel(part)]


def require_same(emulator: Emulator, stored: Sequence[float] | None, where: Path) -> None:
    """Raise CheckpointError unless the emulator repeats the prediction in its card.

    The hash in the card shows that the weights are those of the card. This check shows that they work as an emulator
    here, with the same answers as on the computer that trained them.
    """
    if stored is None:
        raise CheckpointError(f"{where} has no {SELF_TEST}: pretrain again")
    now = np.array(predictions(emulator))
    then = np.array(stored, dtype=np.float64)
    if now.shape != then.shape or not np.isfinite(now).all():
        raise CheckpointError(f"{where}: the emulator does not predict what its card says: pretrain again")
    off = float(np.abs(now - then).max())
    if off > TOLERANCE * max(1.0, float(np.abs(then).max())):
        raise CheckpointError(
            f"{where}: the emulator predicts {off:.2g} beside the prediction in its card (limit {TOLERANCE:g}): its "
            "weights were changed; install or make the checkpoint again"
        )


def rescaled_to(emulator: Emulator, task: Task) -> Emulator:
    """The emulator as one of `task`, the same one with other ranges. Raises CheckpointError if whole numbers differ.

    Inputs are scaled by the ranges. The change from one range to another is an affine map, which becomes part of the
    first layer.
    """
    theirs, ours = inputs(emulator.task), inputs(task)
    for old, new in zip(theirs, ours, strict=True):
        if _levels(old) != _levels(new):
            raise CheckpointError(
                f"the emulator of {task.name} was trained for other integer values than this object has: pretrain"
            )
    ends = ([space.low[None] for space in ours], [space.high[None] for space in ours])
    low, high = (
        encode(emulator.task, parameters, context, action, nuisance)[0].astype(np.float64)
        for parameters, action, nuisance, context in ends
    )
    whole = np.concatenate([_is_whole(space) for space in ours if len(space)])
    scale, shift = np.where(whole, 1.0, (high - low) / 2.0), np.where(whole, 0.0, (high + low) / 2.0)
    tensors = emulator.tensors
    for w, b in (("w0", "b0"), ("pw0", "pb0")):
        first = tensors[w].astype(np.float64)
        tensors[b] = (tensors[b] + np.einsum("f,mfh->mh", shift, first)[:, None]).astype(np.float32)
        tensors[w] = (first * scale[:, None]).astype(np.float32)
    return Emulator(task, tensors)


def _levels(space: Space) -> list[tuple[float, float]]:
    return [(d.low, d.high) for d in space.dimensions if d.scale == "integer"]


def _is_whole(space: Space) -> Array:
    """Whether each input of a space belongs to a whole number."""
    return np.concatenate(
        [np.full(int(d.high - d.low) + 1, True) if d.scale == "integer" else [False] for d in space.dimensions]
    ).astype(bool)
