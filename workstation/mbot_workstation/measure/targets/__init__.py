"""Boards, markers and gray cards: their dimensions once, for printing and for finding them."""
