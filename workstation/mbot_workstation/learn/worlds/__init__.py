"""What is trained in: robots at their task, one or many in a process a core."""
