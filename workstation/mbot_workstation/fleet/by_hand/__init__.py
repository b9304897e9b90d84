"""Driving by hand, from whatever a hand can hold: a dead man's switch, and what moves it."""
