"""Mutants of the safety path, generated: `make mutants`, `make mutants-all`."""
