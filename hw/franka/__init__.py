"""The real arms: a Franka Panda or FR3 behind `hw.ports.GuardedArm`, and its hand behind `hw.ports.Hand`.

`arm.open_franka` connects. From there: `arm.py` (what a failure means), `checks.py` and `starting.py` (what is
refused), `process.py` and `player.py` (the process that speaks to the arm), `playback.py` (a motion, cycle by cycle),
`touching.py` (what a guarded motion felt), `connection.py` with `fr3.py` and `panda.py` (the SDKs). The hand is by
itself: `hand_process.py` (the program's end), `hand_keeper.py` (the process that can stop it), `hand_worker.py` with
`hand.py` (the process that moves it).
"""
