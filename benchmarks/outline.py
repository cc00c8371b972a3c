"""Measure the outline of arm and hand (`hw.outline`), capsules that contain the maker's meshes of all arms; or fit it.

    PYTHONPATH=tests/support python benchmarks/outline.py
    PYTHONPATH=tests/support python benchmarks/outline.py --fit --starts 256 --steps 1200    # on a GPU: two minutes
    PYTHONPATH=tests/support python benchmarks/outline.py --adjust    # two minutes

It measures how far the farthest point of the meshes lies outside of the outline (never above 0), and the excess. The
excess is the distance of the outline's own surface from the meshes, at the worst point and in the mean. Parts inside a
neighbouring link at every angle of the joint between them do not count as excess. A link's meshes are those of all
arms; the outline holds them solid, not only their surface.

The adjustment of another arm's meshes keeps the outline that was fitted and moves it as little as these need, by a
random search with a fixed seed: a wider capsule costs more than a moved one. The rows of links 1 to 4 were fitted to
the FR3 v2. The other links were only widened by up to 0.3 mm, to keep the margin.

The fit starts at random segments and moves ends and radii down the gradient of excess plus uncovered depth (Adam, all
starts at once). Then it widens the capsules until nothing is uncovered, and by `MARGIN_M`. The signed distances lie on
a grid: distances to points of the surface, signs by winding numbers (Van Oosterom and Strackee, IEEE Transactions on
Biomedical Engineering, 1983).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from arm_meshes import MODELS, Array, Body, bodies
from own_judge import poses

from hw.outline import ARM, FINGERS, HAND

CELL_M, ROOM_M = 0.003, 0.05
SURFACE_M = 0.002
MARGIN_M = 0.0005
OPENINGS_M = (0.0, 0.02, 0.04, 0.06, 0.08)
"""The fingers are held at every opening: their body is the union over these."""
ANGLES_RAD = np.linspace(-np.pi, np.pi, 16, endpoint=False)
BODIES = (*(f"link {i}" for i in range(8)), "hand", "fingers")
CAPSULES = (3, 2, 2, 3, 3, 3, 3, 3, 4, 2)
SHELL = 400
NEAR_M, MOST_THINNER_M = 0.012, 0.004
"""An adjustment looks at points so near to the outline's surface, and makes no capsule thinner by more than this."""

Tensor = torch.Tensor
DEVICE = "cuda" if torch.cuda.is_available() else "cpu"


@dataclass(frozen=True, eq=False)
class Solid:
    """The union of meshes in one frame: signed distances on a grid, and the points that an outline must hold."""

    name: str
    low_m: Tensor  # (3,) corner of the grid
    signed_m: Tensor  # (X, Y, Z), negative inside
    points_m: Tensor  # (P, 3) surface and inside

    @property
    def grid_m(self) -> Tensor:
        """(X, Y, Z, 3) the grid's points."""
        steps = zip(self.low_m, self.signed_m.shape, strict=True)
        axes = [low + CELL_M * torch.arange(count, device=DEVICE) for low, count in steps]
        return torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1)

    def at(self, points_m: Tensor) -> Tensor:
        """Points (..., 3) -> (...) signed distances, between the grid's points; outside of it those of its border."""
        size = CELL_M * (torch.tensor(self.signed_m.shape, device=DEVICE) - 1)
        place = (2.0 * (points_m - self.low_m) / size - 1.0).flip(-1).reshape(1, 1, 1, -1, 3)
        field = self.signed_m[None, None]
        near = torch.nn.functional.grid_sample(field, place, align_corners=True, padding_mode="border")
        return near.reshape(points_m.shape[:-1])


def tensor(values: Array) -> Tensor:
    return torch.as_tensor(values, dtype=torch.float32, device=DEVICE)


def solid(name: str, meshes: Sequence[Body]) -> Solid:
    """The union of `meshes`."""
    surfaces = [tensor(mesh.points_m(SURFACE_M)) for mesh in meshes]
    everything = torch.cat(surfaces)
    low, high = everything.amin(0) - ROOM_M, everything.amax(0) + ROOM_M
    count = ((high - low) / CELL_M).ceil().int().tolist()
    body = Solid(name, low, torch.zeros(count, device=DEVICE), everything)
    at = body.grid_m.reshape(-1, 3)
    signed = torch.full((len(at),), torch.inf, device=DEVICE)
    for mesh, surface in zip(meshes, surfaces, strict=True):
        far = torch.cat([torch.cdist(block, surface).amin(1) for block in torch.split(at, 2048)])
        inside = torch.cat([_winding(block, tensor(mesh.triangles_m)) > 0.5 for block in torch.split(at, 16384)])
        signed = torch.minimum(signed, torch.where(inside, -far, far))
    held = torch.cat([everything, at[signed < 0.0]])
    return Solid(name, low, signed.reshape(count), held)


def _winding(at_m: Tensor, triangles_m: Tensor) -> Tensor:
    """(n,) how often the surface of triangles (T, 3, 3) winds around points (n, 3): 1 inside, 0 outside."""
    a, b, c = (triangles_m[None, :, i] - at_m[:, None] for i in range(3))
    la, lb, lc = (v.norm(dim=-1) for v in (a, b, c))
    volume = (a * torch.linalg.cross(b, c)).sum(-1)
    ab, bc, ca = ((u * v).sum(-1) for u, v in ((a, b), (b, c), (c, a)))
    return 2.0 * torch.atan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum(1) / (4.0 * np.pi)


def solids() -> dict[str, Solid]:
    """Every link, hand and fingers, the meshes of all arms together; inside of a neighbour counts as inside."""
    arms = [bodies(model) for model in MODELS]
    alone = {f"link {i}": solid(f"link {i}", [meshes[i] for meshes in arms]) for i in range(8)}
    alone["hand"] = solid("hand", [arms[0][8]])
    alone["fingers"] = solid("fingers", [body for opening_m in OPENINGS_M for body in bodies("fr3", opening_m)[9:]])
    return {name: replace(body, signed_m=_with_neighbours(name, alone)) for name, body in alone.items()}


def _with_neighbours(name: str, alone: dict[str, Solid]) -> Tensor:
    body, grid = alone[name], alone[name].grid_m
    signed, link = body.signed_m, _link(name)
    for other in BODIES:
        apart = abs(min(_link(other), 8) - link)
        if other == name or apart > 1:
            continue
        q_rad = np.tile(ANGLES_RAD[:, None], (1, 7))
        X_BL = poses(q_rad)
        X_OL = tensor(np.linalg.inv(X_BL[:, _link(other)]) @ X_BL[:, link])
        always = torch.stack([alone[other].at(grid @ X[:3, :3].T + X[:3, 3]) for X in X_OL]).amax(0)
        signed = torch.minimum(signed, always)
    return signed


def _link(name: str) -> int:
    return int(name[-1]) if name.startswith("link") else 8


def gaps(rows: Tensor, at_m: Tensor) -> Tensor:
    """Capsules (S, K, 7) and points (n, 3) or (S, n, 3) -> (S, K, n) distances outside of each; negative inside."""
    start, axis, radius = rows[..., None, :3], (rows[..., 3:6] - rows[..., :3])[..., None, :], rows[..., 6:]
    arm = (at_m if at_m.dim() == 2 else at_m[:, None]) - start
    share = ((arm * axis).sum(-1) / ((axis * axis).sum(-1) + 1e-12)).clamp(0.0, 1.0)
    return (((arm - share[..., None] * axis) ** 2).sum(-1) + 1e-14).sqrt() - radius


def shell(count: int) -> Tensor:
    """(count, 4) evenly spread: a direction on the sphere, and the share along the segment."""
    i = np.arange(count) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * i / count), np.pi * (1.0 + 5**0.5) * i
    sphere = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)
    return tensor(np.column_stack([sphere, (i * 0.7548776662) % 1.0]))


def surface(rows: Tensor, points: Tensor) -> Tensor:
    """(S, K, n, 3) points on capsules (S, K, 7): half on the caps, half on the side."""
    start, end, radius = rows[..., None, :3], rows[..., None, 3:6], rows[..., None, 6:]
    sphere, share = points[:, :3], points[:, 3:]
    unit = (end - start) / ((end - start).norm(dim=-1, keepdim=True) + 1e-9)
    along = (sphere * unit).sum(-1, keepdim=True)
    side = sphere - along * unit
    side = side / (side.norm(dim=-1, keepdim=True) + 1e-9)
    half = (torch.arange(len(points), device=DEVICE) % 2 == 0)[:, None]
    cap = torch.where(along > 0, end, start) + radius * sphere
    return torch.where(half, cap, start + share * (end - start) + radius * side)


def excess(rows: Tensor, body: Solid, points: Tensor) -> tuple[Tensor, Tensor]:
    """Capsules (S, K, 7) -> (S, K n) distances of their surface outside of the meshes, and which of it is outermost."""
    at = surface(rows, points).flatten(1, 2)
    near = gaps(rows, at)
    own = torch.eye(rows.shape[1], device=DEVICE).repeat_interleave(len(points), dim=1)
    free = (near + own).amin(1) > 0.0
    return torch.relu(body.at(at)) * free, free


def fit(body: Solid, capsules: int, starts: int, steps: int, seed: int) -> Array:
    """(K, 7) the best of this many random starts."""
    rng = np.random.default_rng(seed)
    must = body.points_m[torch.as_tensor(rng.choice(len(body.points_m), 2500), device=DEVICE)]
    few = shell(SHELL)
    drawn = np.stack([_drawn(must.cpu().numpy(), capsules, rng) for _ in range(starts)])
    rows = tensor(drawn).requires_grad_()
    adam = torch.optim.Adam([rows], lr=2e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, steps, 2e-5)
    for _ in range(steps):
        adam.zero_grad()
        out = torch.relu(gaps(rows, must).amin(1))
        far, free = excess(rows, body, few)
        worst = ((100.0 * far) ** 8).mean(1).add(1e-12) ** 0.125 / 100.0
        mean = far.sum(1) / free.sum(1).clamp(min=1)
        (worst + 0.5 * mean + 3.0 * out.amax(1) + 30.0 * out.mean(1)).sum().backward()  # type: ignore[no-untyped-call]
        adam.step()
        schedule.step()
    found = rows.detach()
    found[..., 6] += _uncovered(found, body)[:, None]
    far, free = excess(found, body, shell(2000))
    score = far.amax(1) + 0.5 * far.sum(1) / free.sum(1).clamp(min=1) + (found[..., 6].amin(1) < 0.003)
    best = (found[score.argmin()] * 1e4).round() / 1e4
    best[:, 6] += float(_uncovered(best[None], body)[0]) + MARGIN_M
    best[:, 6] = (best[:, 6] * 1e4).ceil() / 1e4
    return best.cpu().numpy().astype(np.float64)


def _uncovered(rows: Tensor, body: Solid) -> Tensor:
    """(S,) how far the farthest point lies outside of all capsules; negative: inside."""
    return torch.stack([gaps(rows, block).amin(1).amax(1) for block in torch.split(body.points_m, 4096)]).amax(0)


def _drawn(points: Array, capsules: int, rng: np.random.Generator) -> Array:
    """(K, 7) segments along the main axis of random clusters."""
    centres = points[rng.choice(len(points), capsules, replace=False)]
    for _ in range(int(rng.integers(1, 6))):
        label = np.linalg.norm(points[:, None] - centres[None], axis=-1).argmin(axis=1)
        filled = [k for k in range(capsules) if (label == k).any()]
        centres[filled] = [points[label == k].mean(axis=0) for k in filled]
    rows = []
    for k in range(capsules):
        own = points[label == k] - centres[k] if (label == k).sum() > 3 else rng.normal(0.0, 0.02, (10, 3))
        spread, axes = np.linalg.svd(own, full_matrices=False)[1:]
        half = rng.uniform(0.3, 1.2) * spread[0] / np.sqrt(len(own)) * axes[0] + rng.normal(0.0, 0.003, 3)
        rows.append([*(centres[k] - half), *(centres[k] + half), max(1.2 * spread[1] / np.sqrt(len(own)), 0.01)])
    return np.array(rows)


def committed(name: str) -> Array:
    """(K, 7) the outline of a body in `hw.outline`."""
    links = tuple(c for c in ARM if name == f"link {c.link}")
    chosen = {"hand": HAND, "fingers": FINGERS}.get(name, links)
    return np.array([[*c.start_m, *c.end_m, c.radius_m] for c in chosen])


def adjusted(name: str, seed: int, tries: int = 3500) -> Array:
    """(K, 7) the outline of a link, moved so that it contains the meshes of every arm with the margin."""
    rng = np.random.default_rng(seed)
    points = np.concatenate([bodies(model)[_link(name)].points_m(0.003) for model in MODELS])
    rows = committed(name)
    far = (_axes_m(rows, points) - rows[:, 6:]).min(axis=0)
    near = np.concatenate([rng.permutation(points[far > -NEAR_M])[:4000], points[np.argsort(far)[-300:]]])

    def cost(ends: Array) -> float:
        radii = _needed(ends, rows[:, 6], near)
        wider = np.maximum(radii - rows[:, 6], -MOST_THINNER_M)
        return float(wider.max() + 0.3 * wider.sum() + 0.02 * np.abs(ends - rows[:, :6]).sum())

    best, step_m = rows[:, :6], 0.004
    least = cost(best)
    for number in range(tries):
        moved = best + rng.normal(0.0, step_m, best.shape) * (rng.random(best.shape) < 0.4)
        if (now := cost(moved)) < least:
            best, least = moved, now
        elif number % 50 == 49:
            step_m = max(0.93 * step_m, 2e-4)
    best = best.round(4)
    radii = np.maximum(_needed(best, rows[:, 6], points) + MARGIN_M, rows[:, 6] - MOST_THINNER_M)
    return np.column_stack([best, np.ceil(1e4 * radii) / 1e4])


def _axes_m(rows: Array, points: Array) -> Array:
    """Segments (K, 6+) and points (P, 3) -> (K, P) distances from their axes."""
    start, along = rows[:, None, :3], rows[:, None, 3:6] - rows[:, None, :3]
    share = np.clip(((points - start) * along).sum(-1) / ((along * along).sum(-1) + 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - share[..., None] * along, axis=-1))


def _needed(ends: Array, radii: Array, points: Array) -> Array:
    """(K,) the radii at which each capsule contains its nearest points."""
    apart = _axes_m(ends, points)
    owner = (apart - radii[:, None]).argmin(axis=0)
    return np.array([apart[k, owner == k].max(initial=0.0) for k in range(len(ends))])


def judge(name: str, rows: Array, body: Solid) -> str:
    """One line: count, uncovered depth and excess."""
    far, free = excess(tensor(rows)[None], body, shell(20000))
    mean = float(far.sum() / free.sum())
    deep = float(_uncovered(tensor(rows)[None], body)[0])
    counted = f"{name}: {len(rows)} capsules, farthest point {1e3 * deep:+.2f} mm"
    return f"{counted}, excess at most {1e3 * float(far.max()):.1f}, mean {1e3 * mean:.1f} mm"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--bodies", nargs="+", default=BODIES)
    parser.add_argument("--capsules", type=int, nargs="+", default=CAPSULES, help="for each body")
    parser.add_argument("--starts", type=int, default=8)
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--adjust", action="store_true", help="links 1 to 4, to the meshes of all arms")
    options = parser.parse_args()
    if options.adjust:
        for name in (name for name in ("link 1", "link 2", "link 3", "link 4") if name in options.bodies):
            print(name, *(f"        ({', '.join(f'{v:.4f}' for v in row)})," for row in adjusted(name, 0)), sep="\n")
        return
    every = solids()
    if not options.fit:
        for name in options.bodies:
            print(judge(name, committed(name), every[name]))
        return
    for name, count in zip(options.bodies, options.capsules, strict=True):
        rows = fit(every[name], count, options.starts, options.steps, options.seed)
        print(judge(name, rows, every[name]))
        print("\n".join(f"        ({', '.join(f'{v:.4f}' for v in row)})," for row in rows), flush=True)


if __name__ == "__main__":
    main()
