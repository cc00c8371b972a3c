"""The solver that learns the simulator once and asks that."""
