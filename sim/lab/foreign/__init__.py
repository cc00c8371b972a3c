"""Pushing and scooping in MuJoCo, behind the contract of a Drake rollout (`sim.tasks.task.Simulate`).

The motion, the carriage's springs, shapes, masses and frictions are those of training, and what counts as rest and as
an outcome is decided by the same code. Contact is MuJoCo's (docs/why/foreign-physics.md). Nothing but
`sim.lab.physics` imports this, and only for a world that asks for it.
"""
