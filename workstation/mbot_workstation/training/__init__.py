"""Learning the fetch task in simulation: environment, lessons, effects of the real world."""
