"""One robot's calibration: from its folder to everything that simulates it."""
