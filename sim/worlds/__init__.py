"""The worlds that ship with the lab, one folder a task."""
