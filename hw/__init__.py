"""Devices: what an arm, a camera and a bench are, and what every arm refuses."""
