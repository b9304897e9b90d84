"""Recordings of a robot that drives known commands while something watches where it goes."""
