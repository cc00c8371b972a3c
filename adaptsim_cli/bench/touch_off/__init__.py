"""The operator's side of a touch-off: set the tool down, solve, store."""
