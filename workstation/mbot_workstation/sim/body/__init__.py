"""The robot's body: parameters, their table, motor law, and MuJoCo's description."""
