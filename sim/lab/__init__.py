"""The simulated lab: a whole arm, table, object and camera in a world that learning and tracking never see."""
