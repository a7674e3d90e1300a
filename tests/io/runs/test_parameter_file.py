"""Parameter files: what is written comes back, and what is no such file is named."""

import numpy as np
import pytest

from urbanjax.io.runs.parameter_file import read_parameters, write_parameters
from urbanjax.types import ConfigError, FileError

HEAD = "urbanjax: 0.1.0\n"


def test_values_come_back_bit_for_bit(tmp_path):
    bits = np.random.default_rng(0).integers(0, 2**63, 300, np.int64).view(np.float64)
    numbers = [0.1, 1 / 3, 1e-05, 1e300, 5e-324, -0.0, *bits[np.isfinite(bits)].tolist()]
    values = {f"stack.x{i}": number for i, number in enumerate(numbers)}
    values |= {"a.count": 3, "a.mode": "yes", "a.on": True, "a.grid": [1, 0.5], "a.text": "2026-11-30", "a.e": "1e-5"}
    write_parameters(tmp_path / "best.yaml", values, about={"sweep": "s\nurbanjax: 9", "code": "ab12"})
    found = read_parameters(tmp_path / "best.yaml")
    assert found == values
    assert [type(value) for value in found.values()] == [type(value) for value in values.values()]
    assert np.copysign(1, found["stack.x5"]) == -1
    lines = (tmp_path / "best.yaml").read_text().splitlines()
    assert lines[:4] == ["# sweep: s urbanjax: 9", "urbanjax: 0.1.0", "code: ab12", "values:"]
    assert lines[4] == "  stack.x0: 0.1"


def test_a_number_as_people_write_it_is_a_number(tmp_path):
    (tmp_path / "a.yaml").write_text(HEAD + "values: {a.b: 1e-5, a.c: 2E3}\n")
    assert read_parameters(tmp_path / "a.yaml") == {"a.b": 1e-5, "a.c": 2000.0}


WRONG = {
    "urbanjax: [1\n": r"a\.yaml, line 2, column 1: is no YAML",
    HEAD + "values:\n\ta.b: 1\n": r"a\.yaml, line 3, column 1: is no YAML",
    HEAD + "values:\n  a.b: 1\n  a.b: 2\n": r"a\.yaml, line 4, column 3: is no YAML: 'a\.b' twice",
    "- 1\n": r"a\.yaml: must hold the entries urbanjax, code, values",
    "": r"a\.yaml: must hold the entries",
    HEAD + "tau: 1\n": r"a\.yaml: has no use for the entry 'tau'",
    "values: {}\n": r"a\.yaml: does not say of which version it is: add the line 'urbanjax: 0\.1\.0'",
    "urbanjax: 0.0.9\nvalues: {}\n": r"a\.yaml: is of urbanjax 0\.0\.9, this is 0\.1\.0.*write .urbanjax: 0",
    HEAD + "values: [1]\n": r"a\.yaml: 'values' must hold one line",
    HEAD + "values: {a: {b: 1}}\n": r"a\.yaml: 'a' must be a finite number",
    HEAD + "values: {a: .inf}\n": r"a\.yaml: 'a' must be a finite number",
    HEAD + "values: {1: 2}\n": r"a\.yaml: 1 is no dotted key",
    HEAD + "values: {a: !!python/object:os.system 1}\n": r"a\.yaml, line 2, column 13: is no YAML",
    HEAD + "values: {a: 2026-99-99}\n": r"a\.yaml: is no YAML",
}


@pytest.mark.parametrize("text", WRONG)
def test_what_is_no_parameter_file_is_named_in_one_line(text, tmp_path):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(ConfigError, match=WRONG[text]) as found:
        read_parameters(tmp_path / "a.yaml")
    assert "\n" not in str(found.value)


def test_files_that_cannot_be_read_or_written_are_named(tmp_path):
    (tmp_path / "a.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="is no text in UTF-8"):
        read_parameters(tmp_path / "a.yaml")
    with pytest.raises(FileError, match="there is no such file"):
        read_parameters(tmp_path / "b.yaml")
    with pytest.raises(ConfigError, match=r"'a\.b' must be a finite number"):
        write_parameters(tmp_path / "c.yaml", {"a.b": float("nan")}, about={})
    assert not (tmp_path / "c.yaml").exists()
