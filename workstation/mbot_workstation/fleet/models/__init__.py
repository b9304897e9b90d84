"""Policy files before and on their way to a robot: checked, signed, pushed; the servo."""
