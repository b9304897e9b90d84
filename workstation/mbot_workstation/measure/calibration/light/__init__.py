"""Exposure, white balance and light: a gray card found, measured, fitted and drawn."""
