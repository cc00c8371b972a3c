"""Our Panda: model, inverse kinematics and planning."""
