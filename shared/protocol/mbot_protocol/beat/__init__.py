"""One decision as a value."""
