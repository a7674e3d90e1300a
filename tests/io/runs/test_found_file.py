"""Found encounters come back from their file as they were, and what is wrong with one is said in a line."""

import json

import pytest

from urbanjax.evaluation.missions.found import FoundScene
from urbanjax.io.runs.found_file import read_found, write_found
from urbanjax.types import ConfigError, FileError

SCENES = [FoundScene("cut_in", {"time_gap": 0.8123456, "braking": 5.5}), FoundScene("crossing", {"later": -1.25})]


def test_what_is_written_is_read(tmp_path):
    write_found(tmp_path / "found.json", SCENES, about="two of them")
    assert read_found(tmp_path / "found.json") == SCENES


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is no JSON"),
        ("[]", "needs a list 'scenes'"),
        (json.dumps({"scenes": []}), "needs a list 'scenes'"),
        (json.dumps({"scenes": [{"family": "cut_in"}]}), "scene 0: must hold 'family' and 'numbers'"),
        (json.dumps({"scenes": [{"family": "cut_in", "numbers": {"braking": "hard"}}]}), "braking"),
        (json.dumps({"scenes": [{"family": "swerve", "numbers": {}}]}), "'swerve'"),
        (json.dumps({"scenes": [{"family": 3, "numbers": {}}]}), "must be a name"),
    ],
)
def test_a_wrong_file_is_named(tmp_path, text, said):
    path = tmp_path / "found.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=said) as error:
        read_found(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileError, match="no such file"):
        read_found(tmp_path / "found.json")
