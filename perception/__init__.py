"""From camera frames to object tracks."""
