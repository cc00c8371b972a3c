"""Scooping food with a spatula."""

from perception.types import Outcome
from sim.tasks.hardware import Hardware
from sim.tasks.scooping import params, plan, rollout, spatula, suspicion
from sim.tasks.task import LabReport, Task

HARDWARE = Hardware(
    X_FT=spatula.X_FT,
    tool_mass=spatula.TOOL_MASS,
    keep_clear=spatula.KEEP_CLEAR,
    may_touch=spatula.MAY_TOUCH,
    plan=plan.plan,
    build_scene=rollout.build_scene,
    time_step_s=params.time_step_s,
    rest_pose=rollout.rest_pose,
    weighing=("density_scale", rollout.piece_mass_kg),
    suspect=suspicion.edge_too_high,
    course=rollout.course_of,
    tracker="piece",
    home_pitch_rad=params.HOME_PITCH_RAD,
    carries=True,
    edge_m=params.EDGE_M,
    touchable=spatula.TOUCHABLE,
    parts=spatula.parts,
)

TASK = Task(
    name="scooping",
    title="scoop a piece of food from the table with a spatula",
    parameters=params.PARAMETERS,
    margin=params.MARGIN,
    context=params.CONTEXT,
    action=params.ACTION,
    nuisance=params.NUISANCE,
    action_noise=params.ACTION_NOISE,
    observation=params.OBSERVATION,
    adaptation=params.ADAPTATION,
    reuse=params.REUSE,
    unmodelled=params.ScoopingUnmodelled,
    plausible=params.PLAUSIBLE,
    simulate=rollout.simulate,
    reference_context=params.REFERENCE_CONTEXT,
    relocate=rollout.relocate,
    succeeded=rollout.succeeded,
    end_state=rollout.end_state,
    reward_of_success=rollout.reward_of_success,
    object_name="piece of food",
    hardware=HARDWARE,
    report=LabReport(
        columns=("x [m]", "y [m]", "z [m]"),
        outcomes=(Outcome.ON_BLADE, Outcome.ON_TABLE, Outcome.LOST),
        successes=(Outcome.ON_BLADE,),
        ends_in_tool=True,
        places_first=True,
    ),
)
