"""Paths that users give."""

import os

Path = str | os.PathLike[str]


def expanded(path: Path) -> Path:
    """The path, with the home folder instead of a ``~`` at the beginning of a text. Raises a ``TypeError`` for ``bytes``."""
    if isinstance(path, bytes):
        raise TypeError(f"{path!r}: expected a path as text or as a pathlib.Path, not as bytes: os.fsdecode converts it")
    return os.path.expanduser(path) if isinstance(path, str) else path
