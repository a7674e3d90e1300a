import importlib
import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
ROWS = [
    [cell.strip().strip("`") for cell in line.strip("|\n").split("|")]
    for line in (REPOSITORY / "docs" / "equations.md").read_text().splitlines()
    if re.match(r"\| \d", line)
]
BUILT = [row for row in ROWS if row[2] != "not yet"]
EXAMPLES = re.findall(r"```python\n(.*?)```", (REPOSITORY / "README.md").read_text(), re.DOTALL)


def test_every_equation_of_the_paper_has_a_row():
    assert [int(row[0]) for row in ROWS] == list(range(1, 34))


@pytest.mark.parametrize("row", BUILT, ids=[row[0] for row in BUILT])
def test_functions_and_tests_named_for_an_equation_exist(row):
    module, name = row[2].rsplit(".", 1)
    assert callable(getattr(importlib.import_module(module), name))
    assert (REPOSITORY / row[3]).is_file()


@pytest.mark.parametrize("example", EXAMPLES)
def test_examples_of_the_readme_run_as_printed(example, monkeypatch, tmp_path):
    assert len(example.splitlines()) <= 15
    monkeypatch.chdir(tmp_path)
    exec(compile(example, "README.md", "exec"), {})
