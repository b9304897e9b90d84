"""Recorded drives: fetched from a robot, decided once more, filmed, reported."""
