"""`adaptsim doctor`: is all there that an iteration needs, and what mends what is not. Start at `examination`."""
