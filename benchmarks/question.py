"""How long a person waits from the end of the motion to the question, at the data rate of a real Azure Kinect.

    python benchmarks/question.py recording.mkv [--trials 5]

The arm of this rig takes the time of its paths and does nothing else. Its camera gives the picture of the recording 30
times a second, compressed as the device compresses; the mug in it, without its handle, is found and tracked. All else
is a session's: decoding, compressing, encoding, the disk, the track, the pictures of the key moments. Needs the extra
kinect.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from kinect_recording import KinectRecording
from mug import UP, Survey, survey
from numpy.typing import NDArray

from adaptsim_cli.bench.devices.mounted import mounted_as_shipped
from adaptsim_cli.bench.rig import Rig, Tracker
from adaptsim_cli.research.lab_place import Nobody
from adaptsim_cli.session.rig_target import RigTarget
from adaptsim_cli.storage import durable
from calib.types import HandEye
from hw.camera.grabber import Capture
from hw.ports import Arm
from hw.types import Array, CameraModel, Execution, Frame, JointPath
from perception import bottle
from perception.arm_mask import NO_ARM
from perception.cylinder import Cylinder
from perception.geometry import ImageRegion, transform
from perception.types import Outcome
from sim.adaptation.stages import TrialKey
from sim.tasks import get_task

RATE_HZ, AROUND_M, QUALITY = 30.0, 0.22, 92
ON_TABLE_M, NEAR_M = 0.006, 0.008


class TimedArm:
    """Takes as long as its paths."""

    model = "fr3"

    def execute(self, path: JointPath) -> Execution:
        start_s = time.monotonic()
        time.sleep(path.duration_s)
        return Execution(start_s, path.t_s, path.q_rad, path.q_rad, 1.0)


@dataclass
class Repeating:
    """A camera that shows one instant of a recording, and the bench where the object stands already."""

    shot: Capture
    of: CameraModel
    _since_s: float = field(default=0.0)

    def model(self) -> CameraModel:
        return self.of

    def place(self, xy_m: Array, trial: int, attempt: int) -> None:
        return

    def snapshot(self) -> Frame:
        return self.shot.frame(time.monotonic())

    def start_recording(self) -> None:
        self._since_s = time.monotonic()

    def stop_recording(self) -> Sequence[Frame]:
        times_s = np.arange(self._since_s, time.monotonic(), 1.0 / RATE_HZ)
        with ThreadPoolExecutor(max_workers=2) as pool:  # as the driver's process
            return tuple(pool.map(self.shot.frame, times_s))


def alone(frame: Frame, model: CameraModel, seen: Survey) -> NDArray[np.uint16]:
    """(H, W) depth in mm, without readings of anything above the table but the mug's body."""
    view = ImageRegion(model.depth, seen.X_BC @ model.X_CD, slice(0, model.depth.height), slice(0, model.depth.width))
    points_m = transform(view.X_BV, view.directions * (frame.depth_mm.reshape(-1, 1) / 1000.0))
    circle = seen.cylinder.circle
    off_m = np.abs(np.linalg.norm(points_m[:, :2] - circle.centre_m, axis=1) - circle.radius_m)
    mask = (points_m[:, 2] < ON_TABLE_M) | ((off_m < NEAR_M) & (points_m[:, 2] < seen.cylinder.height_m))
    return np.where(mask.reshape(frame.depth_mm.shape), frame.depth_mm, np.uint16(0))


def target_of(recording: Path) -> RigTarget:
    with KinectRecording(recording) as opened:
        model, frame = opened.model(), next(opened.frames())
    seen = survey(frame, model, UP, np.random.default_rng(0))
    circle, height_m = seen.cylinder.circle, seen.cylinder.height_m
    x, y = circle.centre_m
    body, area = Cylinder(circle.radius_m, height_m), (x - AROUND_M, x + AROUND_M, y - AROUND_M, y + AROUND_M)
    mounted_task = mounted_as_shipped(get_task("pushing"), "fr3")
    ok, jpeg = cv2.imencode(".jpg", frame.colour[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    assert ok
    shot = Capture(0.0, 0.0, jpeg.tobytes(), alone(frame, model, seen), None, 0, 0)
    tracker = Tracker(
        find=lambda frame, model, X_BC: bottle.find_bottle(frame, model, X_BC, body, area, circle.centre_m),
        overlay=lambda frame, *_: frame.colour,
        track=lambda it: bottle.track_bottle(
            frames=it.recording.frames,
            model=it.recording.model,
            X_BC=it.recording.X_BC,
            detection=it.detection,
            arm_at=lambda _: NO_ARM,
            t_start_s=it.recording.execution.t_start_s,
            duration_s=it.duration_s,
            area=area,
        ),
        placement=lambda drawn: circle.centre_m,
        context=lambda drawn, detection: drawn,
        outcomes=(Outcome.UPRIGHT, Outcome.TIPPED, Outcome.LOST),
    )
    eye = HandEye(seen.X_BC, 1.0, 0.1, "recorded", "", 0.0)
    scene: Any = Repeating(shot, model)
    rig = Rig("fake", "a rig that waits", cast(Arm, TimedArm()), scene, scene, eye)
    return RigTarget(mounted_task.task, rig, tracker, mounted_task.planner())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--trials", type=int, default=5)
    asked = parser.parse_args()
    target = target_of(asked.recording)
    task, waited_s = target.task, []
    with tempfile.TemporaryDirectory() as folder:
        for trial in range(asked.trials):
            began_s = time.perf_counter()
            placed = target.place(task.reference_context, TrialKey(trial + 1, 0), Nobody())  # type: ignore[arg-type]
            action = task.action.denormalise(np.array([0.5, 0.2]))
            planned = target.plan(placed, action)
            proposed_s = time.perf_counter() - began_s
            executed = target.execute(planned)
            home_s = time.perf_counter()
            files = executed.files()
            durable.write_folder(Path(folder) / str(trial), files)
            stored_s = time.perf_counter() - home_s
            seen = executed.track()
            waited_s.append(time.perf_counter() - home_s)
            frames = 0 if executed.recorded is None else len(executed.recorded.frames)
            back_s = planned.paths[2].duration_s
            print(
                f"trial {trial + 1}: proposal after {proposed_s:.2f} s; {frames} frames, way "
                f"back {back_s:.1f} s; stored {stored_s:.2f} s after it, question after {waited_s[-1]:.2f} s "
                f"({seen.track.outcome.value})",
                flush=True,
            )
    print(f"from the arm at home to the question: median {np.median(waited_s):.2f} s, longest {max(waited_s):.2f} s")


if __name__ == "__main__":
    main()
