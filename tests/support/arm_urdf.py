"""An arm's own description (URDF) with the name and the published masses of another model."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import yaml  # type: ignore[import-untyped]
from own_judge import DESCRIPTION


def described(urdf: str, model: str) -> str:
    """`urdf`, whose links are called link0 to link7, as that of `model`."""
    published = yaml.safe_load((DESCRIPTION / model / "inertials.yaml").read_text(encoding="utf-8"))
    root = ET.fromstring(urdf)
    root.set("name", model)
    for link in root.iter("link"):
        body, inertial = published.get(link.get("name")), link.find("inertial")
        if body is None or inertial is None:
            continue
        numbers = body["inertia"].get("inertia", body["inertia"])
        origin, mass, inertia = (inertial.find(tag) for tag in ("origin", "mass", "inertia"))
        assert origin is not None and mass is not None and inertia is not None
        origin.set("xyz", str(body["origin"]["xyz"]))
        mass.set("value", str(body["mass"]))
        for pair, value in numbers.items():
            inertia.set(f"i{pair}", str(value))
    return ET.tostring(root, encoding="unicode")


def limited(model: str, limits: list[tuple[float, float, float]]) -> str:
    """A description of joints alone: lower and upper limit in rad, velocity in rad/s, of each."""
    joints = "".join(
        f'<joint name="{model}_joint{i}" type="revolute">'
        f'<limit lower="{low}" upper="{high}" velocity="{speed}"/></joint>'
        for i, (low, high, speed) in enumerate(limits, start=1)
    )
    return f'<?xml version="1.0"?><robot name="{model}">{joints}</robot>'
