"""The lens: boards found in photographs, fitted, checked and drawn."""
