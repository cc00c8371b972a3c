"""Worlds of the pendulum."""
