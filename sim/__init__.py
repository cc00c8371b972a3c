"""Tasks, simulation and learning."""
