"""The live page of a running session: the camera, the planned motion, the track, rewards and posterior."""
