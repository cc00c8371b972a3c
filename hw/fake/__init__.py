"""Scripted arm, hand, camera, bench and clock: no physics, no rendering, no waiting."""

from hw.fake.arm import FakeArm
from hw.fake.bench import FakeBench
from hw.fake.camera import FakeCamera
from hw.fake.clock import FakeClock
from hw.fake.guarded import FakeGuardedArm
from hw.grasping import FakeHand

__all__ = ["FakeArm", "FakeBench", "FakeCamera", "FakeClock", "FakeGuardedArm", "FakeHand"]
