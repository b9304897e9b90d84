"""A board with a real firmware: the compiled program on an emulated ATmega328P (simavr)."""
