"""Measuring a real robot, an extra of its own: nothing but commands needs it."""
