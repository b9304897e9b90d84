"""What travels between the sides: keys, rights, schema versions."""
