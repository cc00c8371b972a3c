"""The room of the foreign lab in MuJoCo: franky-sim's FR3, table, tools, board, objects and two cameras.

Nothing of the product is imported here. The lab was built according to the drawings in the documents, with errors that
its owner does not know (`TRUTH`).
"""

from __future__ import annotations

import json
import math
import socket
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import mujoco
import numpy as np
from franky_sim.mujoco_simulator import MujocoSimulator

START_RAD = (0.0, -0.785398, 0.0, -2.356194, 0.0, 1.570796, 0.785398)
KP = (4500.0, 4500.0, 3500.0, 3500.0, 2000.0, 2000.0, 2000.0)
KV = (100.0, 100.0, 70.0, 70.0, 20.0, 20.0, 20.0)
LINK7 = "robot0_fr3_link7"
FLANGE_M = 0.107
HELD = ("nothing", "board", "spatula", "pusher")
OBJECTS = ("piece", "bottle")
COLOUR, DEPTH = (1280, 720), (640, 576)
COLOUR_F, DEPTH_F = 613.4, 503.1
TOOL_KG = {"board": 0.45, "spatula": 0.12, "pusher": 0.15}
FAR_AWAY = {"piece": (-0.5, 0.6), "bottle": (-0.5, 0.9)}
PIECE_M = (0.0130, 0.0120, 0.0100)
BOTTLE_M = (0.03, 0.05)
PATCH_X_M, PATCH_M = 0.75, 0.10
HALF_WIDTH_M = 0.04
ENDS_M = {"edge": (0.0, 0.0, -0.0012), "rear end": (-0.10, 0.0, -0.0012)}
"""The lower middle of both ends of the blade, in the spatula."""

# As the drawings have them: the tool in the flange.
SPATULA = (
    (0.806431107673, 0.591325910150, -0.001592658553, 0.188687746092),
    (0.290505317798, -0.393832935357, 0.872067818096, -0.078994103545),
    (0.515049054856, -0.703725292293, -0.489382451749, 0.306158710579),
    (0.0, 0.0, 0.0, 1.0),
)
PUSHER = (
    (-0.368414948562, -0.267158218086, -0.890447590925, 0.103278634374),
    (-0.879181349105, 0.411451947104, 0.240306992429, -0.124722334079),
    (0.302176407189, 0.871397602552, -0.386465570529, 0.111328623064),
    (0.0, 0.0, 0.0, 1.0),
)


@dataclass(frozen=True)
class Truth:
    """The values that nobody in the lab knows. Metres, rad, in the arm's base frame."""

    camera_eye_m: tuple[float, float, float] = (1.305, 0.055, 0.705)
    camera_target_m: tuple[float, float, float] = (0.735, 0.012, 0.0)
    camera_roll_rad: float = 0.022
    depth_turn_rad: float = 0.0015  # the depth camera's turn from what the factory says
    camera_late_s: float = 0.005
    joint_zero_rad: tuple[float, ...] = (0.0, 0.0008, -0.0006, 0.0010, -0.0005, 0.0007, 0.0)
    table_height_m: float = -0.0032
    table_slope: tuple[float, float] = (0.0045, -0.0028)
    tool_forward_m: float = 0.0011
    tool_height_m: float = 0.0009
    tool_pitch_rad: float = 0.010
    tool_roll_rad: float = -0.004
    piece_friction: float = 0.31
    piece_rolling_m: float = 0.0005  # the lever of its rolling resistance
    bottle_friction: float = 0.11
    patch_friction: float = 0.5
    patch_y_m: float = 0.03
    board_scale: float = 1.0015  # of the print over its drawing


TRUTH = Truth()


def turn(axis: str, angle_rad: float) -> np.ndarray:
    """(3, 3) about an axis of the frame."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array(
        {
            "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
            "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }[axis],
        dtype=float,
    )


def camera_pose(truth: Truth) -> np.ndarray:
    """(4, 4) the colour camera in the base: X right, Y down, Z forward."""
    eye, target = np.array(truth.camera_eye_m), np.array(truth.camera_target_m)
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    X = np.eye(4)
    X[:3, :3] = np.column_stack([x, np.cross(z, x), z]) @ turn("z", truth.camera_roll_rad)
    X[:3, 3] = eye
    return X


def depth_in_colour(turned_rad: float = 0.0) -> np.ndarray:
    """(4, 4) the depth camera in the colour camera, as its maker states it with 0."""
    X = np.eye(4)
    X[:3, :3] = turn("x", -0.105) @ turn("y", turned_rad)
    X[:3, 3] = (-0.0320, -0.0020, 0.0040)
    return X


def tool_in_flange(name: str, truth: Truth) -> np.ndarray:
    """(4, 4) the true pose of the tool, a little off its drawing, about its leading edge."""
    X = np.array(SPATULA if name == "spatula" else PUSHER)
    off = np.eye(4)
    off[:3, :3] = turn("y", truth.tool_pitch_rad) @ turn("x", truth.tool_roll_rad)
    off[:3, 3] = (truth.tool_forward_m, 0.0, truth.tool_height_m)
    return X @ off


def table_height_m(truth: Truth, x_m: float, y_m: float) -> float:
    return truth.table_height_m + truth.table_slope[0] * x_m + truth.table_slope[1] * y_m


def table_rotation(truth: Truth) -> np.ndarray:
    """(3, 3) the table's own axes in the base."""
    z = np.array([-truth.table_slope[0], -truth.table_slope[1], 1.0])
    z /= np.linalg.norm(z)
    x = np.array([1.0, 0.0, truth.table_slope[0]])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def quaternion(R: np.ndarray) -> np.ndarray:
    """(4,) w first."""
    q = np.zeros(4)
    mujoco.mju_mat2Quat(q, np.ascontiguousarray(R).ravel())
    return q


def words(*values: float) -> str:
    return " ".join(f"{v:.12g}" for v in values)


def placed(parent: ET.Element, name: str, X: np.ndarray) -> ET.Element:
    return ET.SubElement(parent, "body", name=name, pos=words(*X[:3, 3]), quat=words(*quaternion(X[:3, :3])))


class Room(MujocoSimulator):
    """franky-sim's simulator with our furniture; a millisecond has four steps of the contact physics."""

    STEPS = 4

    def __init__(self, truth: Truth, board_png: Path | None, folder: Path) -> None:
        super().__init__()
        self.truth, self.folder = truth, folder
        self._furnish(board_png)

    def build(self, q_rad: tuple[float, ...]) -> Any:
        """Add the arm, its tools and objects; start. -> the robot."""
        robot = self.add_robot(initial_q=q_rad, kp=KP, kv=KV)
        link7 = next(b for b in self.worldbody.iter("body") if b.get("name") == LINK7)
        flange = ET.SubElement(link7, "body", name="flange", pos=words(0.0, 0.0, FLANGE_M))
        self._add_board(flange)
        self._add_spatula(flange)
        self._add_pusher(flange)
        self._add_objects()
        self.init()
        self.start()
        self.model.opt.timestep = 0.001 / self.STEPS
        return robot

    def _step(self) -> None:
        for _ in range(self.STEPS):
            mujoco.mj_step(self.model, self.data)

    # what stands in the room

    def _furnish(self, board_png: Path | None) -> None:
        truth, scene, world = self.truth, self.scene, self.worldbody
        visual = scene.find("visual")
        visual.find("quality").set("shadowsize", "1024")
        visual.find("quality").set("offsamples", "4")
        visual.find("headlight").set("ambient", "0.30 0.30 0.29")
        ET.SubElement(visual, "map", znear="0.05", zfar="12")
        ET.SubElement(visual, "global", offwidth="1280", offheight="720")
        ET.SubElement(scene, "statistic", extent="1", center="0.5 0 0.3")
        world.find("geom[@name='ground']").set("pos", "0 0 -0.78")
        for light in world.iter("light"):
            light.set("diffuse", words(*(0.62 * float(v) for v in light.get("diffuse").split())))
        asset = scene.find("asset")
        wood = self.folder / "wood.png"
        cv2.imwrite(str(wood), wooden())
        ET.SubElement(asset, "texture", name="wood", type="2d", file=str(wood))
        ET.SubElement(asset, "material", name="wood", texture="wood", specular="0.15", shininess="0.3")
        if board_png is not None:
            ET.SubElement(asset, "texture", name="print", type="2d", file=str(board_png))
            ET.SubElement(asset, "material", name="print", texture="print", specular="0.02")
        self._has_print = board_png is not None
        R = table_rotation(truth)
        middle = np.array([0.55, 0.0, table_height_m(truth, 0.55, 0.0)])
        self._sheet("top", 1.7, 1.4)
        table = ET.SubElement(world, "body", name="table", pos=words(*middle), quat=words(*quaternion(R)))
        ET.SubElement(
            table, "geom", name="table", type="plane", size="1 1 0.1", contype="3", conaffinity="3", group="4",
            friction="0.3 0.005 0.0001", solref="0.003 1",
        )  # fmt: skip
        ET.SubElement(
            table, "geom", name="table_top", type="mesh", mesh="top", material="wood", contype="0", conaffinity="0"
        )
        ET.SubElement(
            table, "geom", name="patch", type="box", contype="0", conaffinity="0", rgba="0.10 0.32 0.16 1",
            size=words(PATCH_M / 2, PATCH_M / 2, 0.00015), pos=words(PATCH_X_M - 0.55, truth.patch_y_m, 0.00015),
        )  # fmt: skip
        X_BC = camera_pose(truth)
        for name, X, size, f in (
            ("colour", X_BC, COLOUR, COLOUR_F),
            ("depth", X_BC @ depth_in_colour(truth.depth_turn_rad), DEPTH, DEPTH_F),
        ):
            fovy = math.degrees(2.0 * math.atan(size[1] / 2.0 / f))
            R = X[:3, :3] @ np.diag([1.0, -1.0, -1.0])
            ET.SubElement(
                world, "camera", name=name, pos=words(*X[:3, 3]), quat=words(*quaternion(R)), fovy=f"{fovy:.12g}"
            )

    def _sheet(self, name: str, width: float, height: float, scale: float = 1.0) -> None:
        """A flat rectangle in X and Y with a picture on it: the picture's upper edge at +Y."""
        w, h = scale * width / 2, scale * height / 2
        ET.SubElement(
            self.scene.find("asset"), "mesh", name=name, inertia="shell",
            vertex=words(-w, h, 0, w, h, 0, w, -h, 0, -w, -h, 0),
            texcoord="0 0 1 0 1 1 0 1", face="0 2 1 0 3 2",
        )  # fmt: skip

    # what the hand may hold

    def _tool(self, flange: ET.Element, name: str, X: np.ndarray, com: tuple[float, float, float]) -> ET.Element:
        tool = placed(flange, name, X)
        kg = TOOL_KG[name]
        ET.SubElement(tool, "inertial", mass=str(kg), pos=words(*com), diaginertia=words(*[kg * 0.004] * 3))
        return tool

    def _part(self, tool: ET.Element, kind: str, rgba: str, touch: bool, **more: str) -> None:
        mask = {"contype": "2", "conaffinity": "2"} if touch else {"contype": "0", "conaffinity": "0"}
        name = f"{tool.get('name')}_{len(tool)}"
        ET.SubElement(
            tool, "geom", mask | more, name=name, type=kind, rgba=rgba, mass="0", friction="0.2 0.005 0.0001",
            solref="0.003 1",
        )  # fmt: skip

    def _add_board(self, flange: ET.Element) -> None:
        half = math.sqrt(0.5)
        across = np.array([-half, half, 0.0])
        into = np.array([half, half, 0.0])
        X = np.eye(4)  # X right on the print, Y up, Z out of it
        X[:3, :3] = np.column_stack([across, [0.0, 0.0, -1.0], -into]) @ turn("z", 0.013) @ turn("x", -0.02)
        X[:3, 3] = 0.0025 * across + np.array([0.0, 0.0, 0.116 + 0.105]) - 0.001 * into
        board = self._tool(flange, "board", X, (0.0, 0.0, -0.003))
        self._sheet("page", 0.297, 0.210, self.truth.board_scale)
        plate = {"size": words(0.150, 0.107, 0.0025), "pos": words(0.0, 0.0, -0.0028)}
        self._part(board, "box", "0.75 0.75 0.75 1", touch=False, **plate)
        material = {"material": "print"} if self._has_print else {}
        self._part(board, "mesh", "1 1 1 1", touch=False, mesh="page", **material)

    def _add_spatula(self, flange: ET.Element) -> None:
        tool = self._tool(flange, "spatula", tool_in_flange("spatula", self.truth), (-0.16, 0.0, 0.07))
        back, edge, lip, bevel, w = ENDS_M["rear end"][0], ENDS_M["edge"][2], -0.0010, -0.005, HALF_WIDTH_M
        points = [(x, y, z) for y in (-w, w) for x, z in ((back, 0), (bevel, 0), (0, lip), (0, edge), (back, edge))]
        ET.SubElement(self.scene.find("asset"), "mesh", name="blade", vertex=words(*np.ravel(points)), inertia="convex")
        nylon, tape, rise = "0.05 0.05 0.055 1", "0.45 0.45 0.47 1", 0.9
        self._part(tool, "mesh", nylon, touch=True, mesh="blade")
        up = np.array([-math.cos(rise), 0.0, math.sin(rise)])
        root = np.array([-0.10, 0.0, -0.0006])
        leaning = {"quat": words(*quaternion(turn("y", rise)))}
        for length, along, size, colour, touch in (
            (0.05, 0.025, (0.0175, 0.002), nylon, True),
            (0.195, 0.05 + 0.0975, (0.012, 0.006), nylon, False),
            (0.05, 0.215, (0.022, 0.006), tape, False),
        ):
            where = {"size": words(length / 2, *size), "pos": words(*(root + along * up))}
            self._part(tool, "box", colour, touch, **where, **leaning)

    def _add_pusher(self, flange: ET.Element) -> None:
        tool = self._tool(flange, "pusher", tool_in_flange("pusher", self.truth), (-0.03, 0.03, 0.08))
        blue = "0.10 0.17 0.42 1"
        self._part(tool, "box", blue, touch=True, size=words(0.0025, 0.06, 0.04), pos=words(-0.0025, 0.0, 0.04))
        root, grip = np.array([-0.005, 0.0, 0.05]), np.array([-0.074, 0.072, 0.125])
        ends = {"fromto": words(*root, *grip)}
        self._part(tool, "capsule", blue, touch=False, size="0.011", **ends)
        self._part(tool, "box", blue, touch=False, size="0.012 0.012 0.018", pos=words(*grip))

    # what lies on the table

    def _add_objects(self) -> None:
        truth, world = self.truth, self.worldbody
        touch = {"contype": "3", "conaffinity": "3", "solref": "0.003 1", "condim": "4"}
        piece = ET.SubElement(world, "body", name="piece", pos=words(*FAR_AWAY["piece"], 0.02))
        ET.SubElement(piece, "freejoint", name="piece")
        ET.SubElement(
            piece, "geom", touch | {"condim": "6"}, name="piece", type="ellipsoid", size=words(*PIECE_M),
            density="1000", priority="2", rgba="0.78 0.22 0.10 1",
            friction=words(truth.piece_friction, 0.0005, truth.piece_rolling_m),
        )  # fmt: skip
        radius, half = BOTTLE_M
        bottle = ET.SubElement(world, "body", name="bottle", pos=words(*FAR_AWAY["bottle"], half))
        ET.SubElement(bottle, "freejoint", name="bottle")
        ET.SubElement(
            bottle, "geom", touch, name="bottle_bottom", type="cylinder", size=words(radius, 0.001), priority="2",
            pos=words(0, 0, 0.001 - half), mass="0.01", rgba="0.86 0.85 0.80 1",
            friction=words(truth.bottle_friction, 0.0005, 0.00005),
        )  # fmt: skip
        ET.SubElement(
            bottle, "geom", touch, name="bottle", type="cylinder", size=words(radius, half - 0.001), priority="1",
            pos=words(0, 0, 0.001), mass="0.29", rgba="0.86 0.85 0.80 1", friction=words(0.3, 0.0005, 0.00005),
        )  # fmt: skip

    # changes while it runs

    def hold(self, what: str) -> None:
        """Put one tool, or nothing, into the hand."""
        show(self.model, what)
        for name, kg in TOOL_KG.items():
            body = self.model.body(name)
            body.mass[0] = kg if name == what else 1e-6
            body.inertia[:] = (kg if name == what else 1e-6) * 0.004
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))

    def put(self, what: str, x_m: float, y_m: float, yaw_rad: float) -> None:
        """Lay one object onto the table, all others out of the way."""
        for name in OBJECTS:
            at = (x_m, y_m) if name == what else FAR_AWAY[name]
            half = PIECE_M[2] if name == "piece" else BOTTLE_M[1]
            R = table_rotation(self.truth) @ turn("z", yaw_rad if name == what else 0.0)
            p = np.array([*at, table_height_m(self.truth, *at)]) + half * R[:, 2]
            joint = self.data.joint(name)
            joint.qpos[:] = [*p, *quaternion(R)]
            joint.qvel[:] = 0.0

    def feel_patch(self) -> None:
        """The bottle's bottom has the friction of the surface under its middle."""
        x, y = self.data.body("bottle").xpos[:2]
        half = PATCH_M / 2
        on = abs(x - PATCH_X_M) < half and abs(y - self.truth.patch_y_m) < half
        friction = self.truth.patch_friction if on else self.truth.bottle_friction
        self.model.geom("bottle_bottom").friction[0] = friction


def show(model: Any, what: str, *, patch: bool = True) -> None:
    """Only the held tool is visible and has contacts; the patch may be there or not."""
    model.geom_group[model.geom("patch").id] = 0 if patch else 5
    for name in HELD[1:]:
        body = model.body(name)
        first = int(body.geomadr[0])
        for g in range(first, first + int(body.geomnum[0])):
            model.geom_group[g] = 0 if name == what else 5
            touches = name == what and model.geom_dataid[g] != model.mesh("page").id and is_touching(name, g - first)
            model.geom_contype[g] = model.geom_conaffinity[g] = 2 if touches else 0


def is_touching(tool: str, part: int) -> bool:
    """The blade and the neck of the spatula, the plate of the pusher."""
    return (tool == "spatula" and part < 2) or (tool == "pusher" and part == 0)


def wooden() -> np.ndarray:
    """A table top with grain: (H, W, 3) BGR."""
    rng = np.random.default_rng(7)
    rows = cv2.GaussianBlur(rng.standard_normal((700, 1)), (1, 31), 6)
    grain = np.repeat(rows, 850, axis=1) * 2.0
    fine = cv2.GaussianBlur(rng.standard_normal((700, 850)), (61, 3), 12) * 3.0
    wave = grain + fine
    light = 1.0 + 0.06 * wave / wave.std()
    base = np.array([112.0, 140.0, 164.0])
    return np.asarray(np.clip(base * light[..., None], 0, 255), dtype=np.uint8)


class Line:
    """Asks the arm's process."""

    def __init__(self, folder: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.connect(str(folder / "arm.sock"))
        self._file = self._socket.makefile("rw")

    def ask(self, **order: Any) -> dict[str, Any]:
        self._file.write(json.dumps(order) + "\n")
        self._file.flush()
        answer: dict[str, Any] = json.loads(self._file.readline())
        return answer
