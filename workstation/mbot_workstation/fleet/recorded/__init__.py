"""Drives as they were recorded, by a robot or here: fetched, read, completed."""
