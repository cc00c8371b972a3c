"""Tasks, simulation and learning: everything that knows physics."""
