"""A session's posterior as randomisation ranges, for policies that are trained elsewhere."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w

if TYPE_CHECKING:
    from adaptsim_cli.session.store import SessionStore
    from hw.types import Array
    from sim.adaptation.posterior import Posterior

FORMAT = 1
SAMPLES = 1000
LEVELS = (0.025, 0.05, 0.25, 0.5, 0.75, 0.95, 0.975)


def ranges_files(store: SessionStore) -> dict[str, bytes]:
    """Name -> content: the ranges as JSON and TOML, and a snippet for each of three simulators, for a task
    with a friction `mu`.

    Raises SessionError, CheckpointError.
    """
    from adaptsim_cli.session.hindsight import Hindsight

    ranges = ranges_of(store, Hindsight.of(store).posterior(store))
    return {
        "ranges.json": (json.dumps(ranges, indent=1, allow_nan=False) + "\n").encode(),
        "ranges.toml": tomli_w.dumps(ranges).encode(),
        **{name: text.encode() for name, text in SNIPPETS.items() if "mu" in ranges["names"]},
    }


def ranges_of(store: SessionStore, posterior: Posterior) -> dict[str, Any]:
    """Joint samples, marginal quantiles and correlation of the posterior, with names and units."""
    drawn = posterior.draw(SAMPLES, np.random.default_rng(0))
    levels = posterior.quantiles(LEVELS)
    names = list(posterior.space.names)
    return {
        "format": FORMAT,
        "session": store.facts.name,
        "task": store.facts.task,
        "trials": len(_trials(store)),
        "effective_samples": posterior.effective,
        "is_collapsed": posterior.is_collapsed,  # then the ranges are too narrow
        "names": names,
        "units": [d.unit for d in posterior.space.dimensions],
        "scales": [d.scale for d in posterior.space.dimensions],
        "meanings": [d.meaning for d in posterior.space.dimensions],
        "levels": list(LEVELS),
        "quantiles": dict(zip(names, levels.T.tolist(), strict=True)),
        "correlation": correlation(posterior).tolist(),
        "samples": drawn.tolist(),
    }


def correlation(posterior: Posterior) -> Array:
    """(p, p) correlation of the parameters, each on its own scale; a parameter that is certain correlates with none."""
    unit = posterior.space.normalise(posterior.samples)
    centred = unit - posterior.weights @ unit
    covariance = (centred * posterior.weights[:, None]).T @ centred
    std = np.sqrt(np.diag(covariance))
    is_certain = std < 1e-9
    scale = np.where(is_certain, 1.0, std)
    correlations = covariance / np.outer(scale, scale)
    correlations[is_certain] = correlations[:, is_certain] = 0.0
    np.fill_diagonal(correlations, 1.0)
    return np.asarray(correlations)


def _trials(store: SessionStore) -> tuple[Any, ...]:
    from adaptsim_cli.session.history import trials_of

    return trials_of(store)


SNIPPETS: Mapping[str, str] = {
    "drake_ranges.py": '''"""Draws joint parameters of the posterior, and gives a body's contact properties to Drake."""

import json
from pathlib import Path

import numpy as np
from pydrake.geometry import AddCompliantHydroelasticProperties, AddContactMaterial, ProximityProperties
from pydrake.multibody.plant import CoulombFriction

RANGES = json.loads((Path(__file__).parent / "ranges.json").read_text())


def draw(rng: np.random.Generator) -> dict[str, float]:
    """One joint sample: parameter -> value, in the units of RANGES."""
    return dict(zip(RANGES["names"], RANGES["samples"][rng.integers(len(RANGES["samples"]))]))


def contact(sample: dict[str, float], resolution_m: float = 0.005) -> ProximityProperties:
    """Contact properties for a sample; friction `mu`, and hydroelastic modulus `e` in Pa where the task has one."""
    properties = ProximityProperties()
    friction = CoulombFriction(sample["mu"], sample["mu"])
    AddContactMaterial(properties=properties, friction=friction)
    if "e" in sample:
        AddCompliantHydroelasticProperties(resolution_m, sample["e"], properties)
    return properties


if __name__ == "__main__":
    sample = draw(np.random.default_rng(0))
    print(sample, contact(sample).GetPropertiesInGroup("material").keys())
''',
    "playground_ranges.py": '''"""Randomisation for MuJoCo Playground: sets the sliding friction of all geometries.

Playground and JAX do not run where adaptsim is tested, so nobody has run this snippet yet. Fit it to your model.
"""

import json
from pathlib import Path

import jax
import jax.numpy as jp

RANGES = json.loads((Path(__file__).parent / "ranges.json").read_text())
SAMPLES = jp.array(RANGES["samples"])
MU = RANGES["names"].index("mu")


def domain_randomize(model, rng):
    """(model, keys) -> (batched model, axes), as `randomization_fn` takes it."""

    @jax.vmap
    def randomised(key):
        sample = SAMPLES[jax.random.randint(key, (), 0, len(SAMPLES))]
        return model.geom_friction.at[:, 0].set(sample[MU])

    axes = jax.tree_util.tree_map(lambda _: None, model).tree_replace({"geom_friction": 0})
    return model.tree_replace({"geom_friction": randomised(rng)}), axes
''',
    "isaaclab_ranges.py": '''"""Event terms for Isaac Lab: friction from the posterior's 90 % range.

Isaac Lab does not run where adaptsim is tested, so nobody has run this snippet yet. Its events draw each quantity
alone; for joint samples write your own term over RANGES["samples"].
"""

import json
from pathlib import Path

import isaaclab.envs.mdp as mdp
from isaaclab.managers import EventTermCfg, SceneEntityCfg
from isaaclab.utils import configclass

RANGES = json.loads((Path(__file__).parent / "ranges.json").read_text())
LOW, HIGH = (RANGES["levels"].index(level) for level in (0.05, 0.95))
MU = tuple(RANGES["quantiles"]["mu"][i] for i in (LOW, HIGH))


@configclass
class PosteriorEvents:
    friction = EventTermCfg(
        func=mdp.randomize_rigid_body_material,
        mode="startup",
        params={
            "asset_cfg": SceneEntityCfg("object"),
            "static_friction_range": MU,
            "dynamic_friction_range": MU,
            "restitution_range": (0.0, 0.0),
            "num_buckets": 64,
        },
    )
''',
}
"""Name -> text of each snippet. Only the one for Drake runs in our tests."""
