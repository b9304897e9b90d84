"""Text files that people write."""

from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.git_lfs import POINTER, refuse_pointer


def read_text(path: Path) -> str:
    """A file's text, UTF-8, without the mark that some editors put in front.

    Raises:
        ConfigurationError: it can't be read, or is not text.

    """
    text = text_if_any(path)
    if text is None:
        raise ConfigurationError(f"can't read {path}: No such file or directory")
    return text


def text_if_any(path: Path) -> str | None:
    """As `read_text`; None where there is no such file."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise ConfigurationError(f"can't read {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigurationError(f"can't read {path}: it is not text") from None
    refuse_pointer(path, text[: len(POINTER)].encode())
    return text
