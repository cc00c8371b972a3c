"""Pushing and scooping in MuJoCo, behind the contract of a Drake rollout (`sim.tasks.task.Simulate`).

Motion, springs of the carriage, shapes, masses and frictions are those of training, and the same code decides about
rest and outcome. Contact is MuJoCo's (docs/why/foreign-physics.md). Only `sim.lab.physics` imports this package, and
only for a world that asks for it.
"""
