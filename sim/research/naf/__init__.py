"""The solver of the paper, on true rollouts only."""
