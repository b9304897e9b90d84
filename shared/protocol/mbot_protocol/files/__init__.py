"""Files: replaced whole, read as text or TOML with one clear error."""
