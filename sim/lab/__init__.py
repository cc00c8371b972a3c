"""The simulated lab: a whole arm, table, object and camera in a world hidden from learning and tracking."""
