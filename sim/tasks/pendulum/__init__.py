"""Balancing a double pendulum: no robot, no contact, every answer exact. The control experiment of the method."""

from perception.types import Outcome
from sim.tasks.pendulum import params, rollout
from sim.tasks.pendulum.solver import LqrSolver
from sim.tasks.task import LabReport, Task

TASK = Task(
    name="pendulum",
    title="balance a double pendulum with a linear feedback",
    parameters=params.PARAMETERS,
    margin=params.MARGIN,
    context=params.CONTEXT,
    action=params.ACTION,
    nuisance=params.NUISANCE,
    action_noise=params.ACTION_NOISE,
    observation=params.OBSERVATION,
    adaptation=params.ADAPTATION,
    unmodelled=params.PendulumUnmodelled,
    plausible=params.PLAUSIBLE,
    simulate=rollout.simulate,
    simulate_many=rollout.simulate_many,
    reference_context=params.REFERENCE_CONTEXT,
    relocate=rollout.relocate,
    succeeded=rollout.succeeded,
    end_state=rollout.end_state,
    reward_of_success=rollout.reward_of_success,
    object_name="pendulum",
    exact=LqrSolver,
    report=LabReport(
        columns=("q1 [rad]", "q2 [rad]", "q1' [rad/s]", "q2' [rad/s]", "excess cost"),
        outcomes=(Outcome.SETTLED, Outcome.DIVERGED),
        successes=(Outcome.SETTLED,),
        computed=("excess cost",),
    ),
)
