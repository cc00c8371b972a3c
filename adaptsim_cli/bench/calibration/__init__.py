"""`adaptsim calibrate`: the operator's side. The sequence is in `flow.py`."""
