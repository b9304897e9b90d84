"""Watching where a robot goes: through a camera overhead, or SteamVR."""
