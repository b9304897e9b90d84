"""How far simulation and reality are apart, as one page a person can read."""
