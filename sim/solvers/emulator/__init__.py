"""The solver that learns the simulator once and then queries the learned one."""
