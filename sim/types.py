"""Values shared by tasks, arm, pictures and learning: spaces, motions, visuals."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hw.mass import Mass
from hw.types import Array, ContactWindow, frozen_array
from sim.errors import OutOfRange


@dataclass(frozen=True)
class Estimate:
    """A mean with its 95 % interval."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True)
class Suspicion:
    """A likely fault of the rig, from the trials of a session, for a person: whole sentences."""

    question: str
    why: str
    look: str  # how to find out without a command


@dataclass(frozen=True)
class Dimension:
    """One named quantity with its range; `scale` says how it is normalised.

    No fingerprint or file holds the fields after `scale`, and equality ignores them.
    """

    name: str
    unit: str
    low: float
    high: float
    scale: Literal["linear", "log", "integer"] = "linear"
    plain: str = field(default="", compare=False)  # one or two plain words
    meaning: str = field(default="", compare=False)  # one line
    margin: tuple[float, float] | None = field(default=None, compare=False)
    """How far beyond its range the scene was tried; None if it was not tried beyond."""
    limits: tuple[float, float] | None = field(default=None, compare=False)
    """Ends of the physically possible values, within which an exact simulator may search; None if they are those of the
    margin."""
    default: float | None = field(default=None, compare=False)
    """The value in a world that does not state it; None if each world has to state it."""
    words: tuple[str, ...] = field(default=(), compare=False)
    """The kinds of a category, whose value is an index (`scale` "integer"); empty for a number."""
    mirror: Literal[1, -1] = field(default=1, compare=False)
    """-1 if it changes its sign when a trial is mirrored, left for right."""

    @property
    def label(self) -> str:
        """Name and unit, for a person."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def plain_name(self) -> str:
        """The plain name, or the name if there is none."""
        return self.plain or self.name

    @property
    def title(self) -> str:
        """Plain name, name and unit, e.g. `piece height h [cm]`; the name is not repeated."""
        *before, last = self.plain_name.split()
        return " ".join((*before, self.label) if last == self.name else (*before, last, self.label))

    @property
    def kinds(self) -> tuple[str, ...]:
        """The words of a category, by index. They are `words`, or those in the meaning of a whole number, as in `0
        ellipsoid, 1 cylinder`. Empty for a number.
        """
        if self.words or self.scale != "integer":
            return self.words
        named = dict(re.findall(r"(\d+) (\w+)", self.meaning))
        kinds = tuple(named[str(index)] for index in range(len(named)) if str(index) in named)
        return kinds if len(kinds) > self.high else ()

    def shares(self, values: Array, weights: Array | None = None) -> tuple[float, ...]:
        """The share of each of the `kinds` among values (m,) with weights (m,); all the same by default."""
        nearest = np.clip(np.rint(values), 0, len(self.kinds) - 1).astype(int)
        counts = np.bincount(nearest, weights, minlength=len(self.kinds))
        return tuple(float(one) for one in counts / counts.sum())


class NamedValues:
    """The values of a space by name, in units: `p.mu`, a number or the word of a category."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self.__dict__.update(values)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"there is no quantity {name!r}: there are {', '.join(self.__dict__)}")


@dataclass(frozen=True)
class Space:
    """A box of named quantities. Normalised, each runs from 0 (low) to 1 (high); values outside stay outside."""

    dimensions: tuple[Dimension, ...]

    def __len__(self) -> int:
        return len(self.dimensions)

    @property
    def names(self) -> tuple[str, ...]:
        """Names in the order of the dimensions."""
        return tuple(d.name for d in self.dimensions)

    def named(self, value: Array) -> NamedValues:
        """`value` (n,) by name; a category is its word. Raises ValueError for another number of values."""
        pairs = zip(self.dimensions, value, strict=True)
        return NamedValues({d.name: d.words[round(float(v))] if d.words else float(v) for d, v in pairs})

    def in_words(self, value: Array) -> str:
        """`value` (n,) in a sentence: `mu = 0.1, ground = ice`."""
        named = vars(self.named(value)).items()
        return ", ".join(f"{name} = {one if isinstance(one, str) else f'{one:.4g}'}" for name, one in named)

    def columns(self, values: Array) -> dict[str, Array]:
        """`values` (..., n): name -> (...). Raises ValueError for another number of columns."""
        array = np.moveaxis(np.asarray(values, dtype=np.float64), -1, 0)
        return dict(zip(self.names, array, strict=True))

    @property
    def widened(self) -> Space:
        """The same quantities with their margins."""
        return Space(
            tuple(d if d.margin is None else replace(d, low=d.margin[0], high=d.margin[1]) for d in self.dimensions)
        )

    @property
    def physical(self) -> tuple[Array, Array]:
        """(n,) lower and (n,) upper ends of the physically possible values, in units."""
        ends = np.array([d.limits or d.margin or (d.low, d.high) for d in self.dimensions]).reshape(-1, 2)
        return ends[:, 0], ends[:, 1]

    @property
    def mirror(self) -> Array:
        """(n,) -1 for each quantity that changes its sign when a trial is mirrored, else 1."""
        return frozen_array([float(d.mirror) for d in self.dimensions], (len(self),))

    @property
    def low(self) -> Array:
        """(n,) lower ends, in units."""
        return np.array([d.low for d in self.dimensions])

    @property
    def high(self) -> Array:
        """(n,) upper ends, in units."""
        return np.array([d.high for d in self.dimensions])

    @property
    def middle(self) -> Array:
        """(n,) the middle of the normalised box, in units."""
        return self.denormalise(np.full(len(self), 0.5))

    @property
    def _log(self) -> NDArray[np.bool_]:
        return np.array([d.scale == "log" for d in self.dimensions], dtype=bool)

    @property
    def _integer(self) -> NDArray[np.bool_]:
        return np.array([d.scale == "integer" for d in self.dimensions], dtype=bool)

    def normalise(self, value: Array) -> Array:
        """(..., n) in units -> (..., n) normalised."""
        value = np.asarray(value, dtype=np.float64)
        low, high, log = self.low, self.high, self._log
        linear = (value - low) / (high - low)
        if not log.any():
            return linear
        with np.errstate(divide="ignore", invalid="ignore"):
            safe = np.where(log, value, 1.0)
            low_log, high_log = np.log(np.where(log, low, 1.0)), np.log(np.where(log, high, np.e))
            return np.where(log, (np.log(safe) - low_log) / (high_log - low_log), linear)

    def denormalise(self, unit: Array) -> Array:
        """(..., n) normalised -> (..., n) in units; integer quantities are rounded."""
        unit = np.asarray(unit, dtype=np.float64)
        low, high, log = self.low, self.high, self._log
        linear = low + unit * (high - low)
        ratio = np.where(log, high, 1.0) / np.where(log, low, 1.0)
        value = np.where(log, np.where(log, low, 1.0) * ratio**unit, linear)
        return np.where(self._integer, np.round(value), value)

    def step(self, value: Array, directions: NDArray[np.int_], delta: float) -> Array:
        """Move `value` by `delta` of each range times `directions` in {-1, 0, 1}, clipped to the box.

        Integer quantities move by one.
        """
        size = np.where(self._integer, 1.0 / (self.high - self.low), delta)
        return self.denormalise(np.clip(self.normalise(value) + size * directions, 0.0, 1.0))

    def contains(self, value: Array) -> bool:
        """Whether `value` (n,) in units lies in the box, its ends included."""
        value = np.asarray(value, dtype=np.float64)
        tol = 1e-9 * (self.high - self.low)
        return bool(((value >= self.low - tol) & (value <= self.high + tol)).all())

    def check(self, value: Array, what: str) -> Array:
        """`value` as a read-only (n,) array. Raises OutOfRange naming the first value outside."""
        array = frozen_array(value, (len(self),), what)
        for d, v in zip(self.dimensions, array, strict=True):
            if not d.low - 1e-9 * (d.high - d.low) <= v <= d.high + 1e-9 * (d.high - d.low):
                raise OutOfRange(f"{what}: {d.label} = {v:.4g} lies outside of [{d.low:g}, {d.high:g}]")
        return array

    def sample(self, rng: np.random.Generator, n: int) -> Array:
        """(n, len) uniform in the normalised box."""
        return self.spread(rng.random((n, len(self))))

    def spread(self, unit: Array) -> Array:
        """(..., len) in [0, 1) -> (..., len) in units; integers get equal shares, both ends included."""
        levels = np.floor(self.low + unit * (self.high - self.low + 1.0))
        return np.where(self._integer, np.minimum(levels, self.high), self.denormalise(unit))

    def unspread(self, value: Array, within: Array) -> Array:
        """The inverse of `spread`: (..., len) in units -> (..., len) in [0, 1]. `within` (..., len) in [0, 1) places an
        integer inside its share.
        """
        share = (value - self.low + within) / (self.high - self.low + 1.0)
        return np.where(self._integer, share, self.normalise(value))


@dataclass(frozen=True, eq=False)
class ToolMotion:
    """A motion of the tool: poses of the tool frame T in the base frame B at 1 kHz, at rest at both ends."""

    t_s: Array  # (N,) from 0
    X_BT: Array  # (N, 4, 4)
    contact: ContactWindow | None = None

    def __post_init__(self) -> None:
        t_s = frozen_array(self.t_s, (None,), "t_s")
        object.__setattr__(self, "t_s", t_s)
        object.__setattr__(self, "X_BT", frozen_array(self.X_BT, (len(t_s), 4, 4), "X_BT"))


@dataclass(frozen=True, eq=False)
class Texture:
    """A grey picture printed on a plane of a body: on z = 0 of its own frame P, from the origin along X and Y."""

    albedo: NDArray[np.float32]  # (h, w) linear, 0..1; row 0 along Y = 0
    X_OP: Array  # (4, 4) the picture's frame P in the body's frame
    size_m: tuple[float, float]  # along X and Y


@dataclass(frozen=True, eq=False)
class Visual:
    """A coloured triangle mesh fixed to a body of the plant (or to the world), as a camera sees it."""

    body: str  # name of the body in the plant; "world" for fixed meshes
    vertices_m: Array  # (V, 3) in the body's frame
    triangles: NDArray[np.int32]  # (F, 3)
    rgb: tuple[float, float, float]  # albedo, linear, 0..1
    texture: Texture | None = None  # replaces `rgb` where the mesh's surface lies on it


def merged(
    meshes: Sequence[tuple[Array, NDArray[np.integer]]],
) -> tuple[Array, NDArray[np.int32]]:
    """Vertices (V, 3) and triangles (F, 3) of several meshes in one."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    triangles = [one + start for (_, one), start in zip(meshes, starts[:-1], strict=True)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(triangles).astype(np.int32)


@dataclass(frozen=True, eq=False)
class Part:
    """A solid that a lab prints, in metres."""

    name: str  # of its file
    solid: Any  # trimesh.Trimesh, closed, in a frame that its maker names
    notes: tuple[str, ...]  # orientation, screws, what to do
    count: int = 1
    down: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))  # (3,) lies on the printer's bed
    held_m: float | None = None  # width between the fingers; None: they do not hold it
    mass: Mass | None = None  # that the scene knows, in the same frame
    flat: bool = False  # an outline to cut along instead of a solid


@dataclass(frozen=True, eq=False)
class PredictedOutcomes:
    """Predicted outcomes of trials, as an expected reward needs them."""

    success: Array  # (...) chance
    end_state: Array  # (..., k) of a success
    failure_reward: Array | None = None  # (...) of a failure; None: in this task it earns nothing

    @property
    def mean_of_ensemble(self) -> PredictedOutcomes:
        """The mean of predictions (M, ...) over the M members of an ensemble."""
        failed = None if self.failure_reward is None else self.failure_reward.mean(axis=0)
        return PredictedOutcomes(self.success.mean(axis=0), self.end_state.mean(axis=0), failed)


@dataclass(frozen=True)
class EmulatorReport:
    """Figures from rollouts that neither training nor calibration used."""

    rollouts: int  # trained on
    held_out: int
    base_rate: float  # share of successes; it or its complement is the accuracy of a constant guess
    accuracy: float
    brier: float
    calibration_error: float  # expected, ten bins
    position_error_median: float  # last observed position, in state units (m)
    position_error_p90: float
    end_state_error_median: float  # of successes, in units
    temperature: float
    misfit_limit: float
