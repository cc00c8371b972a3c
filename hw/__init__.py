"""Devices: the ports of arm, camera and bench, and the limits that every arm enforces."""
