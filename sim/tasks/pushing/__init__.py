"""Pushing a bottle to a goal."""

from sim.tasks.pushing.mount import KEEP_CLEAR, TOOL_MASS, X_FT, parts
from sim.tasks.pushing.params import (
    ACTION,
    ACTION_NOISE,
    ADAPTATION,
    BOTTLE_HEIGHT_M,
    BOTTLE_RADIUS_M,
    CONTEXT,
    MARGIN,
    MIRROR,
    NUISANCE,
    OBSERVATION,
    PARAMETERS,
    PLAUSIBLE,
    REFERENCE_CONTEXT,
    REUSE,
    START_M,
    Unmodelled,
    goal_m,
)
from sim.tasks.pushing.plan import plan
from sim.tasks.pushing.rollout import (
    bottle_mass_kg,
    course_of,
    end_state,
    relocate,
    reward_of_success,
    simulate,
    succeeded,
)
from sim.tasks.pushing.scene import build_scene, rest_pose, time_step_s
from sim.tasks.task import Hardware, Standing, Task

HARDWARE = Hardware(
    X_FT=X_FT,
    tool_mass=TOOL_MASS,
    keep_clear=KEEP_CLEAR,
    plan=plan,
    build_scene=build_scene,
    time_step_s=time_step_s,
    rest_pose=rest_pose,
    weighing=("bottle_mass_scale", bottle_mass_kg),
    course=course_of,
    tracker="bottle",
    parts=parts,
    standing=Standing(BOTTLE_RADIUS_M, BOTTLE_HEIGHT_M, START_M),
)

TASK = Task(
    name="pushing",
    title="push a bottle across the table to a goal with a plate",
    parameters=PARAMETERS,
    margin=MARGIN,
    context=CONTEXT,
    action=ACTION,
    nuisance=NUISANCE,
    action_noise=ACTION_NOISE,
    observation=OBSERVATION,
    adaptation=ADAPTATION,
    reuse=REUSE,
    unmodelled=Unmodelled,
    plausible=PLAUSIBLE,
    mirror=MIRROR,
    simulate=simulate,
    reference_context=REFERENCE_CONTEXT,
    relocate=relocate,
    succeeded=succeeded,
    end_state=end_state,
    reward_of_success=reward_of_success,
    object_name="bottle",
    goal_m=goal_m,
    hardware=HARDWARE,
)
