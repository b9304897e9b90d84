"""Pages to print at their exact size: boards and markers."""
