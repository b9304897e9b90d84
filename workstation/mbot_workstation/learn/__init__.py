"""Learning the fetch task in simulation, and finding out what was learned."""
