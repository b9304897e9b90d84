"""What tasks on a floor have in common: tape, walls, ways, where to look, a guide."""
