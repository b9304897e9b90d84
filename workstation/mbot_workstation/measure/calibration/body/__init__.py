"""Masses and dimensions: weighed and measured parts checked and drawn."""
