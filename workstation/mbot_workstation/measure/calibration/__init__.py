"""Measuring a robot with things at hand: its camera, its body, its light, its room."""
