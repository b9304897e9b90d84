"""What stands around a robot: floor, walls, rooms, objects, and how they look."""
