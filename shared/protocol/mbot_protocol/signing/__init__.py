"""What is signed: models and releases, and whose keys count."""
