"""Rays are sent only where a body can be: nothing of it may lie outside."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hw.poses import inverse
from hw.types import Array
from sim.lab.kinect import kinect_model
from sim.panda.shapes import visuals
from sim.render.bodies import Body
from sim.render.rays import field_of_view, outline, pixel_rays


@pytest.mark.parametrize("which", ["colour", "depth"])
@pytest.mark.parametrize("near_m", [0.3, 0.9])
def test_no_pixel_of_a_body_is_missed(which: str, near_m: float) -> None:
    camera = getattr(kinect_model("small"), which)
    rays, rng = pixel_rays(camera), np.random.default_rng(3)
    fov, body = field_of_view(rays), body_of("panda_link5")
    sent = 0
    for _ in range(25):
        X_CO = np.eye(4)
        X_CO[:3, :3] = Rotation.random(random_state=rng).as_matrix()
        X_CO[:3, 3] = np.array([*rng.uniform(-0.6, 0.6, 2), 1.0]) * rng.uniform(near_m, near_m + 0.4)
        seen = outline(_placed(body, X_CO), body.parts, camera, fov)
        hits = body.cast(inverse(X_CO), rays.reshape(-1, 3))
        asked = np.zeros((camera.height, camera.width), dtype=bool)
        asked[seen] = True
        assert asked.ravel()[hits.index].all()
        sent += asked.sum() - len(hits.index)
    assert sent < 25 * 0.1 * camera.width * camera.height


def test_a_body_behind_the_camera_may_be_anywhere_and_one_out_of_view_is_nowhere() -> None:
    camera = kinect_model("small").depth
    fov, body = field_of_view(pixel_rays(camera)), body_of("panda_link5")
    around, beside = np.eye(4), np.eye(4)
    beside[:3, 3] = 5.0, 0.0, 1.0
    assert len(outline(_placed(body, around), body.parts, camera, fov)[0]) == camera.width * camera.height
    assert not len(outline(_placed(body, beside), body.parts, camera, fov)[0])


def test_parts_hang_together() -> None:
    body = body_of("panda_link6")
    assert len(body.parts) == 4  # a sphere and three cylinders
    assert [part.stop for part in body.parts][-1] == len(body.points_m)


def body_of(link: str) -> Body:
    return Body([visual for visual in visuals() if visual.body == link])


def _placed(body: Body, X_CO: Array) -> Array:
    return np.asarray(body.points_m @ X_CO[:3, :3].T + X_CO[:3, 3])[None]
