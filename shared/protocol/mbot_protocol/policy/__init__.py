"""What a policy is: its contract, its file's bytes, its memory."""
