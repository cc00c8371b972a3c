"""Pushing a bottle to a goal."""

from perception.types import Outcome
from sim.tasks.hardware import Hardware, Standing
from sim.tasks.pushing import bottle, mount, params, plan, rollout
from sim.tasks.task import LabReport, Task

HARDWARE = Hardware(
    X_FT=mount.X_FT,
    tool_mass=mount.TOOL_MASS,
    keep_clear=mount.KEEP_CLEAR,
    plan=plan.plan,
    build_scene=rollout.build_scene,
    time_step_s=params.time_step_s,
    rest_pose=bottle.rest_pose,
    weighing=("bottle_mass_scale", bottle.bottle_mass_kg),
    course=rollout.course_of,
    tracker="bottle",
    edge_m=mount.PLATE_THICKNESS_M,
    parts=mount.parts,
    standing=Standing(params.BOTTLE_RADIUS_M, params.BOTTLE_HEIGHT_M, params.START_M),
)

TASK = Task(
    name="pushing",
    title="push a bottle across the table to a goal with a plate",
    parameters=params.PARAMETERS,
    margin=params.MARGIN,
    context=params.CONTEXT,
    action=params.ACTION,
    nuisance=params.NUISANCE,
    action_noise=params.ACTION_NOISE,
    observation=params.OBSERVATION,
    adaptation=params.ADAPTATION,
    reuse=params.REUSE,
    unmodelled=params.PushingUnmodelled,
    plausible=params.PLAUSIBLE,
    mirror=params.MIRROR,
    simulate=rollout.simulate,
    reference_context=params.REFERENCE_CONTEXT,
    relocate=rollout.relocate,
    succeeded=rollout.succeeded,
    end_state=rollout.end_state,
    reward_of_success=rollout.reward_of_success,
    object_name="bottle",
    goal_m=params.goal_m,
    hardware=HARDWARE,
    report=LabReport(
        columns=("x [m]", "y [m]", "z [m]"),
        outcomes=(Outcome.UPRIGHT, Outcome.TIPPED, Outcome.LOST),
        successes=(Outcome.UPRIGHT,),
    ),
)
