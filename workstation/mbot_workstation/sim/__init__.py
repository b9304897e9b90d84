"""The simulated robot, room and task: no real time, no devices, cheap to step."""
