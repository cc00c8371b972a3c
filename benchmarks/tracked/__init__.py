"""What `tracking.py` measures, one module a task."""
