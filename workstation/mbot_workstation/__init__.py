"""Simulation, training and tools around the robot."""
