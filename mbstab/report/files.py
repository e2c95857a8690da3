"""Files that are written completely or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

NAMED = 50
"""Characters of the name of a file that its temporary one has, too: file systems take 255 bytes, of up to four each."""


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Yield a stream to a file that replaces `path` once it is complete, so that no partial file appears.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    from tempfile import mkstemp  # its imports take as long as all of click

    goal = Path(path).resolve()
    handle, temporary = mkstemp(dir=goal.parent, prefix=f".{goal.name[:NAMED]}.")
    os.close(handle)
    try:
        with open(temporary, "wb") as stream:
            yield stream
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, goal.stat().st_mode & 0o777 if goal.exists() else 0o666 & ~mask)
        os.replace(temporary, goal)
    except BaseException:
        os.unlink(temporary)
        raise
