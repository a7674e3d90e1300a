import dataclasses
import importlib
import inspect
import re
from pathlib import Path

import numpy as np
import pytest

from tests.io.maps import texts
from tests.registration.conftest import courtyard

REPOSITORY = Path(__file__).resolve().parent.parent
ROWS = [
    [cell.strip().strip("`") for cell in line.strip("|\n").split("|")]
    for line in (REPOSITORY / "docs" / "equations.md").read_text().splitlines()
    if re.match(r"\| \d", line)
]
BUILT = [row for row in ROWS if row[2] != "not yet"]


def examples(name: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (REPOSITORY / name).read_text(), re.DOTALL)


def test_every_equation_of_the_paper_has_a_row():
    assert [int(row[0]) for row in ROWS] == list(range(1, 34))


@pytest.mark.parametrize("row", BUILT, ids=[row[0] for row in BUILT])
def test_functions_and_tests_named_for_an_equation_exist(row):
    module, name = row[2].rsplit(".", 1)
    assert callable(getattr(importlib.import_module(module), name))
    assert (REPOSITORY / row[3]).is_file()


@pytest.mark.parametrize("example", examples("README.md"))
def test_examples_of_the_readme_run_as_printed(example, monkeypatch, tmp_path):
    assert len(example.splitlines()) <= 15
    monkeypatch.chdir(tmp_path)
    exec(compile(example, "README.md", "exec"), {})


@pytest.mark.slow
@pytest.mark.parametrize("example", examples("docs/tuning.md"))
def test_examples_of_tuning_run_as_printed(example):
    assert len(example.splitlines()) <= 12
    exec(compile(example, "tuning.md", "exec"), {})


def write_inputs(folder: Path) -> None:
    """The files that the guide names: a map, two scans 0.3 m apart, and two logs."""
    (folder / "crossing.xml").write_text(texts.COMMONROAD)
    for seed, (name, shift) in enumerate({"source": 0.3, "target": 0.0}.items()):
        points = courtyard(3000, seed) - [shift, 0.0, 0.0]
        header = "".join(f"property float {axis}\n" for axis in "xyz")
        rows = "\n".join(" ".join(f"{x:.4f}" for x in point) for point in points)
        text = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{header}end_header\n{rows}\n"
        (folder / f"{name}.ply").write_text(text)
    for seed, name in enumerate(("one", "two")):
        x, y = np.cumsum(np.random.default_rng(seed).uniform(0.1, 0.3, (2, 400)), axis=1)
        rows = "\n".join(f"{k / 10},{a:.4f},{b:.4f}" for k, (a, b) in enumerate(zip(x, y, strict=True)))
        (folder / f"{name}.csv").write_text(f"time,x,y\n{rows}\n")


def test_examples_of_the_guide_run_as_printed(monkeypatch, tmp_path):
    """One after the other, as a reader would go on from each to the next."""
    write_inputs(tmp_path)
    monkeypatch.chdir(tmp_path)
    known: dict = {}
    for example in examples("docs/guide.md"):
        exec(compile(example, "docs/guide.md", "exec"), known)
    assert (tmp_path / "drive.png").stat().st_size > 10_000
    assert known["found"].mahalanobis(np.eye(4) + 0.3 * np.eye(4)[:, :1] * np.eye(4)[3]) < 3.55


@pytest.mark.parametrize(
    "name", ["scene", "drive", "kl_divergence", "surrogate_safety", "register", "evaluate", "qualify", "score"]
)
def test_what_the_guide_calls_is_named_by_its_package_and_says_shapes_and_units(name):
    from urbanjax import evaluation, registration, traffic
    from urbanjax.io import figures, maps

    (package,) = (p for p in (evaluation, registration, traffic, figures, maps) if name in dir(p))
    function = getattr(package, name)
    assert name in package.__all__
    assert "Args:" in inspect.getdoc(function)
    kinds = [kind for kind in inspect.get_annotations(function).values() if dataclasses.is_dataclass(kind)]
    for record in kinds:
        assert "Fields:" in inspect.getdoc(record), record
