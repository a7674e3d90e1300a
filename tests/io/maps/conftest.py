"""Writes a map's text to a file and reads it."""

import pytest

from urbanjax.io import maps


@pytest.fixture
def read(tmp_path):
    def reader(text, name="map.xml"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return maps.read(path)

    return reader
