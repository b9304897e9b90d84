"""What a policy tolerates: one thing made wrong, step by step."""
