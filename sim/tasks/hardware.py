"""The parts of a task with arm and camera: tool, motion, scene, tracker."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from hw.capsules import Capsule
from hw.mass import Mass
from hw.types import Array
from perception.types import ObjectTrack
from sim.panda.tool import Touchable
from sim.types import Part, Suspicion, ToolMotion, Visual

if TYPE_CHECKING:
    import pydrake.geometry as drake_geometry
    import pydrake.multibody.plant as drake_plant
    import pydrake.multibody.tree as drake_tree


@dataclass(frozen=True, eq=False)
class SceneBodies:
    """The bodies that `BuildScene` added to a plant."""

    tool: str  # name of the tool's body; its body frame is T
    object: str  # name of the object's free body; its body frame is at the centre, Z up at rest
    visuals: tuple[Visual, ...]  # tool, object, table
    apart: tuple[tuple[drake_geometry.GeometryId, drake_geometry.GeometryId], ...] = ()
    """Pairs that pass through each other (`sim.tasks.shared.contact.keep_apart`)."""


class BuildScene(Protocol):
    """Adds table, object and tool to a plant. The physics is the same whether a carriage or an arm drives the tool."""

    def __call__(
        self,
        plant: drake_plant.MultibodyPlant,
        tool_parent: drake_tree.Frame,
        X_PT: Array,
        parameters: Array,
        nuisance: Array,
        unmodelled: Any,
    ) -> SceneBodies:
        """Weld (or flex-mount) the tool at X_PT (4, 4) in `tool_parent`; also sets the plant's contact model."""


@dataclass(frozen=True, eq=False)
class Standing:
    """A round object that stands on a mark before a trial, with the sizes for its tracker."""

    radius_m: float
    height_m: float
    mark_m: Array  # (2,) in the frame of the arm's base


def no_suspicion(tracks: Sequence[ObjectTrack]) -> None:
    """For tasks whose trials never suggest a fault of the rig. It is a function because a task travels to worker
    processes.
    """


@dataclass(frozen=True, eq=False)
class Hardware:
    """The parts of a task with arm and camera: tool, motion, scene, tracker."""

    X_FT: Array  # (4, 4) the tool in the arm's flange
    tool_mass: Mass  # mass of the tool, in its frame T, without the hand
    keep_clear: tuple[Capsule, ...]
    """Capsules in the tool's frame T that contain the parts of the tool that must stay clear of arm, table and boxes.
    """
    plan: Callable[[Array, Array], ToolMotion]  # (context, action) -> motion
    build_scene: BuildScene
    time_step_s: Callable[[Any], float]  # time step of the plant, given the unmodelled effects (None: training)
    rest_pose: Callable[[Array, Array, Array, Any], Array]
    """(context, parameters, nuisance, unmodelled) -> X_BO (4, 4) of the object at rest before the trial."""
    tracker: str  # the key of the tracker in adaptsim_cli.bench.devices.trackers
    standing: Standing | None = None  # for a tracker of objects that stand on a mark
    home_pitch_rad: float = 0.0
    """Pitch of the tool between trials; positive: front down."""
    carries: bool = False
    """Whether the tool carries the object home, so that the way there must be gentle."""
    edge_m: float = 0.001
    """Width of the tool's narrowest edge, which decides the pressure of a contact with a person."""
    may_touch: tuple[Capsule, ...] = ()  # parts that may touch the table but neither arm nor boxes, as `keep_clear`
    touchable: Touchable | None = None  # how its tool finds the table by touch; None: not possible
    parts: Callable[[], tuple[Part, ...]] = tuple  # what a lab prints for it; raises ExtraMissing
    weighing: tuple[str, Callable[[Array, Array, Any], float]] | None = None
    """The effect that scales the object's mass; (parameters, nuisance, unmodelled) -> mass without that effect, kg."""
    suspect: Callable[[Sequence[ObjectTrack]], Suspicion | None] = no_suspicion
    """The tracks of all trials of a session, in order -> what they hint at; None: nothing."""
    course: Callable[[ToolMotion, Array, Array, Any], Any] | None = None
    """(motion, X_BO, nuisance, unmodelled) -> a rollout without its physics (`sim.tasks.shared.readings.Course`), from
    which a scene is exported; None: not possible."""
