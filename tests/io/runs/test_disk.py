"""What is said where nothing can be written."""

import errno
from pathlib import Path

import pytest

from urbanjax.io.runs.disk import is_of_disk, of_disk


@pytest.mark.parametrize(
    ("number", "room"), [(errno.ENOSPC, True), (errno.EFBIG, True), (errno.EROFS, False), (errno.EACCES, False)]
)
def test_a_disk_that_takes_nothing_is_named_with_what_to_do(number, room):
    error = OSError(number, "no", "a/b.csv")
    assert is_of_disk(error)
    assert of_disk(error, Path("a")).startswith("a/b.csv: ")
    assert ("make room there" in of_disk(error, Path("a"))) == room
    assert "hydra.sweep.dir=DIR" in of_disk(error, Path("a"))
    assert of_disk(OSError(number, "no"), Path("a")).startswith("a: ")


def test_other_errors_are_not_of_the_disk():
    assert not is_of_disk(FileNotFoundError(errno.ENOENT, "no"))
    assert not is_of_disk(ValueError("no"))
