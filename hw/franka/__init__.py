"""The real arms: a Franka Panda or FR3 behind `hw.ports.Arm`, and its hand behind `hw.ports.Hand`.

`arm.open_franka` connects. From there: `arm.py` (the meaning of failures), `motions.py` (before and
after a motion), `process.py` and `player.py` (the process that speaks to the arm), `playback.py` (a motion, cycle by
cycle), `connection.py` (the SDKs). The hand has its own processes:
`hand_process.py` (the program's end), `hand_keeper.py` (the process that can stop it), `hand.py` (the process that
moves it).
"""
