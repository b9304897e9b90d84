"""In what robots, cameras and rooms differ from the nominal ones: effects, and ranges of them."""
