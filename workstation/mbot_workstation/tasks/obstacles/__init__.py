"""Fetch, among boxes, chairs and bags."""
