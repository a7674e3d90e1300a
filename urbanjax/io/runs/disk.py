"""A disk that takes nothing any more."""

import errno
import os
from pathlib import Path
from typing import TypeGuard

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
UNWRITABLE = (*FULL, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO)


def is_of_disk(error: BaseException) -> TypeGuard[OSError]:
    """Whether it says that nothing can be written: a disk is full or a folder read-only. Args: error."""
    return isinstance(error, OSError) and error.errno in UNWRITABLE


def of_disk(error: OSError, folder: Path) -> str:
    """What is said of it. Args: error; folder, into which was written."""
    what = os.strerror(error.errno) if error.errno else str(error)
    room = "make room there, or " if error.errno in FULL else ""
    return (
        f"{error.filename or folder}: {what}; {room}name another folder with hydra.run.dir=DIR or "
        "hydra.sweep.dir=DIR; what is written already is kept"
    )
