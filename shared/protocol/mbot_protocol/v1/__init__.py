"""Version 1 of the messages; messages_pb2 is generated from messages.proto by `make protocol`."""
