"""What somebody may have meant by a word that nobody knows."""

from collections.abc import Iterable


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """ "; did you mean NAME?", to end an error with, or nothing where no known word is like it."""
    from difflib import get_close_matches

    small = {name.lower(): name for name in known}
    found = get_close_matches(word.lower(), small, n=1)
    return f"; did you mean {small[found[0]]}?" if found else ""
