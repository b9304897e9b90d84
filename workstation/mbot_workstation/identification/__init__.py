"""From recorded manoeuvres to the simulated robot's motors, wheels and delays."""
