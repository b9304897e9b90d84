"""One robot's calibration folder: its files as data, and the simulated robot they describe."""
