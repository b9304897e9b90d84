"""Learning a task in simulation, and finding out what was learned."""
