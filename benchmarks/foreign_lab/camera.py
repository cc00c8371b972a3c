"""The camera of the foreign lab: colour, depth and infrared pictures by MuJoCo's own renderer.

    python camera.py FOLDER [BOARD_PNG]

At FOLDER/camera.sock: {"do": "model"}, {"do": "snapshot"}, {"do": "start"}, {"do": "stop"}, a JSON line each. A picture
is answered as a JSON line with its stamp and the sizes of JPEG, depth and infrared data, which follow. Films are drawn
after the motion, from the states that the arm's process has stored with their times. The true poses of object and tool
in each picture of a film are written to FOLDER/truth.jsonl, one line per film.
"""

from __future__ import annotations

import json
import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault("MUJOCO_GL", "egl")

import cv2
import mujoco
import numpy as np
from world import COLOUR, COLOUR_F, DEPTH, DEPTH_F, FAR_AWAY, START_RAD, TRUTH, Line, Room, depth_in_colour, show

PERIOD_S = 1.0 / 20.0
NOISE = {"colour": 2.0, "depth_m": 0.0015, "infrared": 12.0}
EXPOSURE = 0.75  # as the rig of this lab has it, after a first calibration refused an overexposed board
EDGE_M = 0.04
STILL = 2e-5  # m or rad
SERIAL = "foreign-000417"


class Pictures:
    def __init__(self, folder: Path, board: Path | None) -> None:
        self._room = Room(TRUTH, board, folder)
        self._room.build(START_RAD)
        model = self._room.model
        self._colour = mujoco.Renderer(model, COLOUR[1], COLOUR[0])
        self._depth = mujoco.Renderer(model, DEPTH[1], DEPTH[0])
        self._rng = np.random.default_rng(11)
        self._last: Any = None  # what was drawn last: nothing is drawn anew of a room in which nothing moves

    def take(self, state: list[Any], infrared: bool) -> tuple[dict[str, Any], bytes]:
        """(t, held, qpos) -> the header and the data of a picture."""
        t_s, held, qpos = state
        now = np.array(qpos)
        if self._last is None or self._last[0] != (held, infrared) or np.abs(self._last[1] - now).max() > STILL:
            self._last = (held, infrared), now, self._draw(held, now, infrared)
        bgr, z, bright = self._last[2]
        jpeg, depth, grey = self._jpeg(bgr), self._depth_data(z), b"" if bright is None else self._grey(bright)
        head = {"t": t_s + TRUTH.camera_late_s, "jpeg": len(jpeg), "depth": len(depth), "infrared": len(grey)}
        return head, jpeg + depth + grey

    def truth(self, states: list[list[Any]]) -> dict[str, Any]:
        """The poses (4, 4) of objects and tool in the base frame in each state, with the stamps of their pictures."""
        data, held = self._room.data, states[-1][1]
        names = ("piece", "bottle", held)
        told: dict[str, Any] = {"held": held, "t_s": [], **{name: [] for name in names}}
        for t_s, _, qpos in states:
            data.qpos[:] = qpos
            mujoco.mj_kinematics(self._room.model, data)
            told["t_s"].append(t_s + TRUTH.camera_late_s)
            for name in names:
                body = data.body(name)
                told[name].append(np.column_stack([body.xmat.reshape(3, 3), body.xpos]).round(6).tolist())
        return told

    def _draw(self, held: str, qpos: np.ndarray, infrared: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """The colour image (BGR), the depth in m, and the infrared image, all without noise."""
        room = self._room
        room.data.qpos[:] = qpos
        show(room.model, held, patch=room.data.joint("bottle").qpos[1] < FAR_AWAY["bottle"][1] - 0.1)
        mujoco.mj_forward(room.model, room.data)
        self._colour.update_scene(room.data, "colour")
        colour = EXPOSURE * self._colour.render().astype(np.float32)[..., ::-1]
        depth, bright = self._depth, None
        depth.update_scene(room.data, "depth")
        if infrared:
            bright = depth.render().mean(axis=2) * 6.0
        depth.enable_depth_rendering()
        z = depth.render().astype(np.float32)
        depth.disable_depth_rendering()
        return colour, z, bright

    def _jpeg(self, bgr: np.ndarray) -> bytes:
        noisy = bgr + NOISE["colour"] * self._rng.standard_normal(bgr.shape, dtype=np.float32)
        seen = np.clip(noisy, 0, 255).astype(np.uint8)
        return bytes(cv2.imencode(".jpg", seen, (cv2.IMWRITE_JPEG_QUALITY, 92))[1].tobytes())

    def _grey(self, bright: np.ndarray) -> bytes:
        noisy = bright + NOISE["infrared"] * self._rng.standard_normal(bright.shape)
        return np.clip(noisy, 0, 65535).astype("<u2").tobytes()

    def _depth_data(self, z: np.ndarray) -> bytes:
        rng, box = self._rng, np.ones((3, 3), np.uint8)
        edge = cv2.dilate(z, box) - cv2.erode(z, box) > EDGE_M
        noisy = z + NOISE["depth_m"] * rng.standard_normal(z.shape, dtype=np.float32)
        noisy[edge & (rng.random(z.shape) < 0.6)] = 0.0
        noisy[(z < 0.25) | (z > 3.0)] = 0.0
        return bytes(np.rint(1000.0 * noisy).astype("<u2").tobytes())


def model() -> dict[str, Any]:
    """As the maker's calibration of this camera states it."""

    def intrinsics(size: tuple[int, int], f: float) -> dict[str, Any]:
        (w, h) = size
        return {"width": w, "height": h, "K": [[f, 0, (w - 1) / 2], [0, f, (h - 1) / 2], [0, 0, 1]]}

    return {
        "serial": SERIAL,
        "colour": intrinsics(COLOUR, COLOUR_F),
        "depth": intrinsics(DEPTH, DEPTH_F),
        "X_CD": depth_in_colour().tolist(),
    }


def shots(order: dict[str, Any], arm: Line, marks: list[int]) -> Iterator[list[Any]]:
    if order["do"] == "snapshot":
        now = arm.ask(do="now")
        yield [now["t"], now["held"], now["qpos"]]
    elif order["do"] == "stop":
        yield from arm.ask(do="since", mark=marks.pop(), every_s=PERIOD_S)["states"]


def main(folder: str, board: str = "") -> None:
    arm, pictures = Line(Path(folder)), Pictures(Path(folder), Path(board) if board else None)
    path = Path(folder) / "camera.sock"
    path.unlink(missing_ok=True)
    server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    server.bind(str(path))
    server.listen()
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    while True:
        client, _ = server.accept()
        marks: list[int] = []
        with client, client.makefile("rwb") as file:
            for line in file:
                order = json.loads(line)
                if order["do"] == "start":
                    marks.append(arm.ask(do="now")["mark"])
                if order["do"] == "model":
                    file.write(json.dumps(model()).encode() + b"\n")
                else:
                    states = list(shots(order, arm, marks))
                    taken = [pictures.take(state, order.get("infrared", False)) for state in states]
                    if order["do"] == "stop":
                        with (Path(folder) / "truth.jsonl").open("a") as told:
                            told.write(json.dumps(pictures.truth(states)) + "\n")
                    file.write(json.dumps([head for head, _ in taken]).encode() + b"\n")
                    for _, data in taken:
                        file.write(data)
                file.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
