"""Balancing a double pendulum: no robot, no contact, every answer exact. The control experiment of the method."""

from sim.tasks.pendulum.params import (
    ACTION,
    ACTION_NOISE,
    ADAPTATION,
    CONTEXT,
    MARGIN,
    NUISANCE,
    OBSERVATION,
    PARAMETERS,
    REFERENCE_CONTEXT,
    Unmodelled,
)
from sim.tasks.pendulum.rollout import end_state, relocate, reward_of_success, simulate, simulate_many, succeeded
from sim.tasks.pendulum.solver import LqrSolver
from sim.tasks.task import Task

TASK = Task(
    name="pendulum",
    title="balance a double pendulum with a linear feedback",
    parameters=PARAMETERS,
    margin=MARGIN,
    context=CONTEXT,
    action=ACTION,
    nuisance=NUISANCE,
    action_noise=ACTION_NOISE,
    observation=OBSERVATION,
    adaptation=ADAPTATION,
    unmodelled=Unmodelled,
    simulate=simulate,
    simulate_many=simulate_many,
    reference_context=REFERENCE_CONTEXT,
    relocate=relocate,
    succeeded=succeeded,
    end_state=end_state,
    reward_of_success=reward_of_success,
    object_name="pendulum",
    exact=LqrSolver,
)
