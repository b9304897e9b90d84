"""What robots are to do: a protocol, and a folder or file a task; none knows another."""
