"""`adaptsim doctor`: checks everything that an iteration needs, with a remedy for each gap. Start at `table`."""
