"""A disk that takes nothing any more."""

import errno
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TypeGuard

RUN_KEY, SWEEP_KEY = "hydra.run.dir", "hydra.sweep.dir"  # by which it is told where to write
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
UNWRITABLE = (*FULL, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO)


def is_of_disk(error: BaseException) -> TypeGuard[OSError]:
    """Whether it says that nothing can be written: a disk is full or a folder read-only. Args: error."""
    return isinstance(error, OSError) and error.errno in UNWRITABLE


def of_disk(error: OSError, folder: Path, *, keys: Sequence[str] = (RUN_KEY, SWEEP_KEY)) -> str:
    """What is said of it. Args: error; folder, into which was written; keys, by which another one is named."""
    what = os.strerror(error.errno) if error.errno else str(error)
    room = "make room there, or " if error.errno in FULL else ""
    others = " or ".join(f"{key}=DIR" for key in keys)
    return f"{error.filename or folder}: {what}; {room}name another folder with {others}; what is written is kept"
