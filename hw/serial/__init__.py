"""Devices on a serial line: the enabling pedal and the balance."""
