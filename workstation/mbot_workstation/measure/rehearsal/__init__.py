"""The whole afternoon of measuring, rehearsed on a virtual robot that nobody has measured yet."""
