"""Policies that are handed on: a signed card beside the model, in a folder for any server."""
