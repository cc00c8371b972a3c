"""The worlds that ship with the lab, one folder per task."""
