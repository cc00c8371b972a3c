"""Scooping food with a spatula."""

from sim.tasks.scooping.params import (
    ACTION,
    ACTION_NOISE,
    ADAPTATION,
    CONTEXT,
    HOME_PITCH_RAD,
    MARGIN,
    NUISANCE,
    OBSERVATION,
    PARAMETERS,
    PLAUSIBLE,
    REFERENCE_CONTEXT,
    REUSE,
    Unmodelled,
)
from sim.tasks.scooping.plan import plan
from sim.tasks.scooping.rollout import (
    course_of,
    end_state,
    piece_mass_kg,
    relocate,
    rest_pose,
    reward_of_success,
    simulate,
    succeeded,
)
from sim.tasks.scooping.scene import build_scene, time_step_s
from sim.tasks.scooping.spatula import KEEP_CLEAR, TOOL_MASS, TOUCHABLE, X_FT, parts
from sim.tasks.task import Hardware, Task

HARDWARE = Hardware(
    X_FT=X_FT,
    tool_mass=TOOL_MASS,
    keep_clear=KEEP_CLEAR,
    plan=plan,
    build_scene=build_scene,
    time_step_s=time_step_s,
    rest_pose=rest_pose,
    weighing=("density_scale", piece_mass_kg),
    course=course_of,
    tracker="piece",
    home_pitch_rad=HOME_PITCH_RAD,
    carries=True,
    touchable=TOUCHABLE,
    parts=parts,
)

TASK = Task(
    name="scooping",
    title="scoop a piece of food from the table with a spatula",
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
    simulate=simulate,
    reference_context=REFERENCE_CONTEXT,
    relocate=relocate,
    succeeded=succeeded,
    end_state=end_state,
    reward_of_success=reward_of_success,
    object_name="piece of food",
    hardware=HARDWARE,
)
