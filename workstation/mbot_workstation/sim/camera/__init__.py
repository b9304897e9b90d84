"""From what is in front of a lens to the picture that comes out of the camera."""
