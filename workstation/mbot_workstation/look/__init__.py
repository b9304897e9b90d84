"""What a person looks at: recorded drives, the console, the demo."""
