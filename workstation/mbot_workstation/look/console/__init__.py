"""A page in the browser for the person beside the robot: what it sees, STOP, a hand's drive."""
