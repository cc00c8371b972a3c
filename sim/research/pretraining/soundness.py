"""The first rollouts of a task, checked before a quarter of an hour is spent on more of them."""

from sim.rollouts.soundness import require_sound

__all__ = ["require_sound"]
