"""What comes in over the network in pieces.

For others: `pieces.Pieces` is one such transfer, which `models` and `releases` put together.
"""
