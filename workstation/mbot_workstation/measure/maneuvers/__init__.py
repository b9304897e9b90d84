"""Driving a robot through the paper's maneuvers and keeping what it was told."""
