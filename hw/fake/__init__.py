"""Scripted arm, camera, bench and clock: no physics, no pictures of their own, no waiting."""

from hw.fake.arm import FakeArm
from hw.fake.bench import FakeBench, Placing
from hw.fake.camera import FakeCamera
from hw.fake.clock import FakeClock

__all__ = ["FakeArm", "FakeBench", "FakeCamera", "FakeClock", "Placing"]
