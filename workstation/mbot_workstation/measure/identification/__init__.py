"""From recorded maneuvers to the simulated robot's motors, wheels and delays."""
