"""Driving a robot through the paper's manoeuvres and keeping what it was told."""
