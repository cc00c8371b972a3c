"""The real arms: a Franka Panda or FR3 behind `hw.ports.GuardedArm`.

`open_franka` connects. From there: `arm.py` (what a failure means), `checks.py` and `starting.py` (what is refused),
`process.py` and `player.py` (the process that speaks to the arm), `playback.py` (a motion, cycle by cycle),
`touching.py` (what a guarded motion felt), `connection.py` with `fr3.py` and `panda.py` (the SDKs). The hand is by
itself (`hand.py`).
"""

from hw.franka.arm import FrankaArm, open_franka
from hw.franka.settings import CollisionThresholds, FrankaSettings, Payload

__all__ = ["CollisionThresholds", "FrankaArm", "FrankaSettings", "Payload", "open_franka"]
