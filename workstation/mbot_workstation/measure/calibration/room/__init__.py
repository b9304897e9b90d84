"""A 360-degree photograph of the robot's room: checked, levelled, turned and imported."""
