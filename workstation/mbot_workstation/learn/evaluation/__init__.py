"""What a policy is worth: seeded episodes, figures with intervals, what it looks at."""
