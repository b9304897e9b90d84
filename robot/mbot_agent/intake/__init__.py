"""What comes in over the network in pieces."""
