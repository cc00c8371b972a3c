"""Training of the emulator from a dataset, with its held-out report."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hw.extras import missing
from hw.types import Array
from perception.types import Outcome
from sim.errors import DatasetError, ExtraMissing
from sim.rollouts.dataset import Dataset
from sim.rollouts.run import OUTCOMES, Requests, Rollouts, concatenate
from sim.solvers.emulator.network import PRIOR_SCALE, Emulator, encode
from sim.solvers.misfit import misfit
from sim.solvers.threads import one_thread
from sim.storage.files import Tensors
from sim.tasks.task import Task
from sim.types import EmulatorReport

try:
    import torch
    from torch import Tensor, relu_
    from torch.nn.functional import binary_cross_entropy_with_logits
except ImportError as error:
    raise ExtraMissing(missing("pretraining", "torch", "learn")) from error


def with_mirror_images(task: Task, dataset: Dataset) -> Dataset:
    """The dataset, and after it all its rollouts mirrored, in the same order; the dataset itself if `Task.mirror` is
    None.

    Only for learning: row i + N mirrors row i, so denser rollouts do not come last any more.
    """
    mirror = task.mirror
    if mirror is None:
        return dataset
    requests, rollouts = dataset.requests, dataset.rollouts
    mirrored = Requests(
        requests.parameters * mirror.parameters,
        requests.context,
        requests.action * mirror.action,
        requests.nuisance * mirror.nuisance,
    )
    observed = task.observation.normalise(task.observation.denormalise(rollouts.observation) * mirror.observed)
    again = replace(rollouts, observation=observed, end_state=rollouts.end_state * mirror.end_state)
    return replace(dataset, requests=requests.followed_by(mirrored), rollouts=concatenate([rollouts, again]))


Rows = NDArray[np.intp]

SMALLEST = 64
"""Fewest rollouts for training."""

TEMPERATURE_SPREAD = 0.5
"""Prior standard deviation of the logarithm of the temperature.

Without a prior, every prediction would become certain if 150 held-out rollouts happened to be predicted well."""


@dataclass(frozen=True)
class EmulatorSettings:
    """Size of the ensemble and length of its training."""

    members: int = 5
    hidden: int = 96
    layers: int = 3
    batch: int = 256
    learning_rate: float = 1.5e-3
    weight_decay: float = 1e-4
    passes: int = 40  # over the data
    least_steps: int = 800
    most_steps: int = 12000
    held_out: float = 0.15  # share of the evenly spread rollouts: half for calibration, half for the report


def train_emulator(
    task: Task,
    dataset: Dataset,
    seed: int,
    settings: EmulatorSettings | None = None,
    progress: Callable[[int, int], None] | None = None,
    start: Emulator | None = None,
) -> tuple[Emulator, EmulatorReport]:
    """Fit, calibrate and evaluate an ensemble. The same seed gives the same numbers. Raises DatasetError.

    `start` is an emulator of the same task, of the same size, whose networks are trained on.
    """
    settings = settings or EmulatorSettings()
    if len(dataset) < SMALLEST:
        raise DatasetError(f"{len(dataset)} rollouts are too few to learn from: simulate {SMALLEST} or more")
    rng = np.random.default_rng(seed)
    calibrate, judge, train = split(dataset, rng, settings)
    learnt = with_mirror_images(task, dataset)
    rows = np.concatenate([train + first for first in range(0, len(learnt), len(dataset))])
    y, mask = _targets(task, learnt)
    before = None if start is None else start.tensors
    if before is None:
        y_mean, y_std = _scaling(y[rows], mask[rows])
    else:
        y_mean, y_std = (before[name][:-1].astype(np.float64) for name in ("y_mean", "y_std"))
    data = _Data(
        x=torch.from_numpy(encode(task, *_inputs(learnt.requests))),
        y=torch.from_numpy(np.where(mask, (y - y_mean) / y_std, 0.0)).float(),
        mask=torch.from_numpy(mask).float(),
        success=torch.from_numpy(learnt.rollouts.succeeded.copy()).float(),
    )
    with one_thread():
        weights = _fit(data, rows, calibrate, settings, rng, progress, before)
    # The last output is the success logit, which is not scaled.
    tensors = {name: weight.detach().numpy() for name, weight in weights.items()} | {
        "depth": np.array(settings.layers),
        "y_mean": np.append(y_mean, 0.0).astype(np.float32),
        "y_std": np.append(y_std, 1.0).astype(np.float32),
        "temperature": np.array(1.0, dtype=np.float32),
        "residual_std": np.ones(task.observation.size, dtype=np.float32),
        "misfit_limit": np.array(np.inf, dtype=np.float32),
    }
    tensors["temperature"] = np.array(_temperature(Emulator(task, tensors), dataset, calibrate), dtype=np.float32)
    predicted = Emulator(task, tensors).predict(*_inputs(dataset.requests[calibrate]))
    residual = np.abs(predicted.observation - dataset.rollouts.observation[calibrate])[mask[calibrate, 0]]
    # From the median, as for a Gaussian: a few outliers must not widen the tolerance.
    tensors["residual_std"] = (np.median(residual, axis=0) / 0.6745 + 1e-4).astype(np.float32)
    limit = _misfit_limit(Emulator(task, tensors), task, dataset, calibrate, rng)
    tensors["misfit_limit"] = np.array(limit, dtype=np.float32)
    emulator = Emulator(task, tensors)
    return emulator, _judge(emulator, dataset, judge, len(train))


def split(dataset: Dataset, rng: np.random.Generator, settings: EmulatorSettings) -> tuple[Rows, Rows, Rows]:
    """Rows for calibration, evaluation and training. Only evenly spread rollouts are held out."""
    order = np.asarray(rng.permutation(dataset.uniform), dtype=np.intp)
    n = max(16, int(settings.held_out * dataset.uniform))
    denser = np.arange(dataset.uniform, len(dataset))
    return order[: n // 2], order[n // 2 : n], np.concatenate([order[n:], denser])


def outcome_variance(task: Task, seed: int, dataset: Dataset, candidates: Requests) -> Array:
    """(N,) variance of the predicted outcome of each candidate, by an emulator of `dataset`: at most 0.25."""
    draft, _ = train_emulator(task, dataset, seed)
    predicted = draft.predict(*_inputs(candidates))
    return predicted.success * (1.0 - predicted.success)


@dataclass(frozen=True, eq=False)
class _Data:
    x: Tensor  # (N, f)
    y: Tensor  # (N, outputs) standardised
    mask: Tensor  # (N, outputs)
    success: Tensor  # (N,)


def _targets(task: Task, dataset: Dataset) -> tuple[Array, Array]:
    """Outputs (N, size + k), and the mask of known ones. Only a success has a known end state, and a failed solver has
    no known output.

    If a failure may earn a reward, this is one more output, which is known only for failures.
    """
    rollouts = dataset.rollouts
    solved = rollouts.outcome != OUTCOMES.index(Outcome.SOLVER_FAILED)
    parts = [(rollouts.observation, solved), (np.nan_to_num(rollouts.end_state), rollouts.succeeded)]
    if rollouts.failure_reward is not None:
        parts.append((rollouts.failure_reward[:, None], solved & ~rollouts.succeeded))
    masks = [np.repeat(rows[:, None], values.shape[1], axis=1) for values, rows in parts]
    return np.concatenate([values for values, _ in parts], axis=1), np.concatenate(masks, axis=1)


def _scaling(y: Array, mask: Array) -> tuple[Array, Array]:
    weight = mask / np.maximum(mask.sum(axis=0), 1.0)
    mean = (weight * y).sum(axis=0)
    std = np.sqrt((weight * (y - mean) ** 2).sum(axis=0))
    # Constant outputs, such as the start of the object, must stay constant: their errors are scaled down.
    return mean, np.where(std > 1e-6, std, 1e-3)


def _fit(
    data: _Data,
    train: Rows,
    validate: Rows,
    settings: EmulatorSettings,
    rng: np.random.Generator,
    progress: Callable[[int, int], None] | None,
    before: Tensors | None,
) -> dict[str, Tensor]:
    """Train each member on its own bootstrap of the data, and keep the weights with the best validation loss."""
    generator = torch.Generator().manual_seed(int(rng.integers(2**31)))
    widths = [data.x.shape[1], *[settings.hidden] * settings.layers, data.y.shape[1] + 1]
    weights = _initial(settings.members, widths, "w", "b", generator)
    priors = _initial(settings.members, [widths[0], 32, widths[-1]], "pw", "pb", generator)
    if before is not None:
        weights, priors = ({name: torch.from_numpy(before[name].copy()) for name in part} for part in (weights, priors))
    bootstrap = torch.from_numpy(rng.choice(train, size=(settings.members, len(train))))
    steps = int(np.clip(settings.passes * len(train) // settings.batch, settings.least_steps, settings.most_steps))
    for tensor in weights.values():
        tensor.requires_grad_(True)
    optimiser = torch.optim.AdamW(weights.values(), lr=settings.learning_rate, weight_decay=settings.weight_decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.learning_rate, total_steps=steps, pct_start=0.1)
    held = torch.from_numpy(validate).expand(settings.members, -1)
    best, best_loss = {}, math.inf
    for step in range(steps):
        rows = torch.randint(len(train), (settings.members, settings.batch), generator=generator)
        loss = _loss(weights | priors, settings.layers, data, bootstrap.gather(1, rows))
        optimiser.zero_grad()
        torch.autograd.backward(loss)
        optimiser.step()
        schedule.step()
        if (step + 1) % max(1, steps // 20) == 0 or step + 1 == steps:
            with torch.no_grad():
                held_loss = float(_loss(weights | priors, settings.layers, data, held))
            if held_loss < best_loss:
                best_loss, best = held_loss, {name: w.detach().clone() for name, w in weights.items()}
            if progress is not None:
                progress(step + 1, steps)
    return best | priors


def _initial(members: int, widths: list[int], w: str, b: str, generator: torch.Generator) -> dict[str, Tensor]:
    """He initialisation; biases spread so that the kinks of the first layer cover the box of inputs."""
    tensors = {}
    for i, (m, n) in enumerate(itertools.pairwise(widths)):
        gain = math.sqrt((2.0 if i < len(widths) - 2 else 1.0) / m)
        tensors[f"{w}{i}"] = torch.randn(members, m, n, generator=generator) * gain
        tensors[f"{b}{i}"] = (torch.rand(members, 1, n, generator=generator) * 2 - 1) * (1.0 if i == 0 else 0.0)
    return tensors


def forward(tensors: dict[str, Tensor], depth: int, x: Tensor) -> Tensor:
    """(M, N, f) -> (M, N, outputs), standardised: the computation of `Emulator` in torch, for gradients."""
    return _network(tensors, "w", "b", depth, x) + PRIOR_SCALE * _network(tensors, "pw", "pb", 1, x)


def _network(tensors: dict[str, Tensor], w: str, b: str, depth: int, x: Tensor) -> Tensor:
    for layer in range(depth):
        x = relu_(torch.baddbmm(tensors[f"{b}{layer}"], x, tensors[f"{w}{layer}"]))
    return torch.baddbmm(tensors[f"{b}{depth}"], x, tensors[f"{w}{depth}"])


def _loss(tensors: dict[str, Tensor], depth: int, data: _Data, rows: Tensor) -> Tensor:
    raw = forward(tensors, depth, data.x[rows])
    mask = data.mask[rows]
    squared = (mask * (raw[..., :-1] - data.y[rows]) ** 2).sum() / mask.sum().clamp(min=1.0)
    return squared + binary_cross_entropy_with_logits(raw[..., -1], data.success[rows])


def _inputs(requests: Requests) -> tuple[Array, Array, Array, Array]:
    return requests.parameters, requests.context, requests.action, requests.nuisance


def _temperature(emulator: Emulator, dataset: Dataset, rows: Rows) -> float:
    """The softening of the logits that is most probable, given the held-out outcomes and a prior about 1."""
    requests = dataset.requests[rows]
    success = emulator.outcomes(requests.parameters, requests.action, requests.nuisance, requests.context).success
    clipped = np.clip(success, 1e-12, 1.0 - 1e-12)
    logit = np.log(clipped / (1.0 - clipped))
    candidates = np.geomspace(0.1, 8.0, 81)
    posterior = -0.5 * (np.log(candidates) / TEMPERATURE_SPREAD) ** 2
    for i, temperature in enumerate(candidates):
        p = np.clip((1.0 / (1.0 + np.exp(-logit / temperature))).mean(axis=0), 1e-4, 1.0 - 1e-4)
        posterior[i] += np.where(dataset.rollouts.succeeded[rows], np.log(p), np.log(1.0 - p)).sum()
    return float(candidates[int(np.argmax(posterior))])


def _misfit_limit(emulator: Emulator, task: Task, dataset: Dataset, rows: Rows, rng: np.random.Generator) -> float:
    """95th percentile of the distance to the nearest prediction, for trajectories that the simulator can express."""
    inside = [i for i in rows if task.parameters.contains(dataset.requests.parameters[i])][:200]
    if len(inside) < 10:
        return 3.0
    requests, shown = dataset.requests, dataset.rollouts.observation
    values = [
        misfit(emulator, requests.context[i], requests.action[i], task.observation.with_noise(shown[i], rng))
        for i in inside
    ]
    return float(np.quantile(values, 0.95))


def held_out_errors(emulator: Emulator, requests: Requests, true: Rollouts) -> dict[str, Array]:
    """The emulator's error for each rollout, by the name of the field of `EmulatorReport` that summarises it.

    Positions count only if the simulator found a solution, and end states only for successes.
    """
    observation = emulator.task.observation
    prediction = emulator.predict(*_inputs(requests))
    solved = true.outcome != OUTCOMES.index(Outcome.SOLVER_FAILED)
    apart = observation.denormalise(prediction.observation)[:, -1] - observation.denormalise(true.observation)[:, -1]
    return {
        "accuracy": ((prediction.success > 0.5) == true.succeeded).astype(np.float64),
        "brier": (prediction.success - true.succeeded) ** 2,
        "position_error_median": np.linalg.norm(apart, axis=-1)[solved],
        "end_state_error_median": np.linalg.norm((prediction.end_state - true.end_state)[true.succeeded], axis=-1),
    }


def reward_error(emulator: Emulator, requests: Requests, true: Rollouts) -> float:
    """The mean error of the expected reward of rollouts, in the unit of the reward, in contexts drawn evenly."""
    task, n = emulator.task, len(requests)
    drawn = task.context.sample(np.random.default_rng(0), n)
    contexts = requests.context if len(task.physical_context) else drawn
    expected = emulator.trial_rewards(requests.parameters, contexts, requests.action, requests.nuisance)
    return float(np.abs(expected - true.rewards(task, contexts)).mean())


def _judge(emulator: Emulator, dataset: Dataset, rows: Rows, trained: int) -> EmulatorReport:
    requests, true = dataset.select(rows)
    errors = held_out_errors(emulator, requests, true)
    position, end = errors["position_error_median"], errors["end_state_error_median"]
    probability = emulator.predict(*_inputs(requests)).success
    return EmulatorReport(
        rollouts=trained,
        held_out=len(rows),
        base_rate=float(true.succeeded.mean()),
        accuracy=float(errors["accuracy"].mean()),
        brier=float(errors["brier"].mean()),
        calibration_error=_calibration_error(probability, true.succeeded),
        position_error_median=float(np.median(position)) if len(position) else math.nan,
        position_error_p90=float(np.quantile(position, 0.9)) if len(position) else math.nan,
        end_state_error_median=float(np.median(end)) if len(end) else math.nan,
        temperature=float(emulator.tensors["temperature"]),
        misfit_limit=emulator.misfit_limit,
    )


def _calibration_error(probability: Array, success: NDArray[np.bool_]) -> float:
    bins = np.minimum((probability * 10).astype(int), 9)
    total = 0.0
    for b in range(10):
        inside = bins == b
        if inside.any():
            total += float(inside.mean()) * abs(float(probability[inside].mean() - success[inside].mean()))
    return total
