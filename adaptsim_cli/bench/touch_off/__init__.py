"""The operator's side of a touch-off: touch the table, touch with the tool, solve, store."""
