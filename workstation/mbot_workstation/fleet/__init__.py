"""Robots as they are reached, owned, driven and supplied: nothing here knows a simulation."""
