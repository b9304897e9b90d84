"""The virtual robot: the simulation in real time, looking like the robot's hardware."""
