"""What is trained in: robots fetching objects, one or many in a process a core."""
