"""Take the object to a mat."""
