"""The real arms: a Franka Panda or FR3 behind `hw.ports.Arm`.

`open_franka` connects. From there: `arm.py` (what is refused, what a failure means), `process.py` and `player.py` (the
process that speaks to the arm), `playback.py` (a motion, cycle by cycle), `connection.py` with `fr3.py` and `panda.py`
(the SDKs).
"""

from hw.franka.arm import FrankaArm, open_franka
from hw.franka.settings import CollisionThresholds, FrankaSettings, Payload

__all__ = ["CollisionThresholds", "FrankaArm", "FrankaSettings", "Payload", "open_franka"]
