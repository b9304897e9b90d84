"""From an action to the wheels, and from a camera's frame to what a policy sees."""
