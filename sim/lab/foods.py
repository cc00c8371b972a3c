"""Foods drawn by a rule instead of chosen: pieces of any size, shape and stiffness, on the edge of a real turner.

The six foods of the paper were chosen. This rule draws from the ranges that edible pieces have, independently of
Omega, and discards none.
"""

from __future__ import annotations

import math

import numpy as np

from sim.errors import UnknownName
from sim.lab.world import Faults, Sensing, World
from sim.tasks.task import Task

HEIGHT_M = (0.004, 0.025)
HALF_WIDTH_M = (0.005, 0.023)
MODULUS_PA = (1e4, 1e6)  # by its logarithm
FRICTION = (0.20, 0.45)
DENSITY_KG_M3 = (300.0, 1200.0)
LIP_M = (0.0007, 0.0011)
EDGE_N_M = (1.5e3, 5e3)
ELLIPSOID, CYLINDER, BOX = 0, 1, 2

COARSEST_STEP_S, FINEST_STEP_S = 1e-3, 1.25e-4
"""Time steps with a blunt edge. A slice of cucumber converges at 1 ms, and a raisin needs half of that (decision 12).
"""


def food_world(task: Task, seed: int, number: int) -> World:
    """Food `number` of `seed` as a world of scooping, always the same. Raises UnknownName for another task."""
    if task.name != "scooping":
        raise UnknownName(f"foods are worlds of scooping, not of {task.name}")
    rng = np.random.default_rng((seed, number))
    height_m, radius_m = rng.uniform(*HEIGHT_M), rng.uniform(*HALF_WIDTH_M)
    shape = int(rng.integers(ELLIPSOID, BOX + 1))
    modulus_Pa = float(np.exp(rng.uniform(*np.log(MODULUS_PA))))
    friction, density = rng.uniform(*FRICTION), rng.uniform(*DENSITY_KG_M3)
    lip_m, edge_N_m = rng.uniform(*LIP_M), rng.uniform(*EDGE_N_M)
    mass_kg = density * volume_m3(shape, radius_m, height_m)
    effects = task.unmodelled(density_scale=density / 1000.0, edge=(lip_m, edge_N_m), dt_s=step_s(mass_kg, edge_N_m))
    values = {"mu": friction, "e": modulus_Pa, "g": shape, "h": 100.0 * height_m}
    parameters = np.array([values[name] for name in task.parameters.names])
    return World(
        f"foods-{seed}-{number}", task.name, "", parameters, np.array([radius_m]), effects, Sensing(), Faults()
    )


def volume_m3(shape: int, radius_m: float, height_m: float) -> float:
    """Volume of a piece as wide as it is deep."""
    share = {ELLIPSOID: 4.0 / 3.0 * math.pi / 2.0, CYLINDER: math.pi, BOX: 4.0}[shape]
    return share * radius_m**2 * height_m


def step_s(mass_kg: float, edge_N_m: float) -> float:
    """The step of the plant: 1 ms, halved until it is no longer than sqrt(m/k) of the piece on a corner of the edge."""
    wanted_s = math.sqrt(mass_kg / edge_N_m)
    step = COARSEST_STEP_S
    while step > wanted_s and step > FINEST_STEP_S:
        step /= 2.0
    return step
