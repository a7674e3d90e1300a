"""A shell completes presets, keys and values, where the command line is one of ours."""

import shutil
import subprocess

import pytest

from tests.conftest import REPOSITORY
from urbanjax.io.runs.completion import completions
from urbanjax.stack import StackParams

SCRIPT = """
source "$1"
python() { printf '%s\\n' preset=fast preset=short seed=0 vehicle.length=4.7 vehicle.width=1.9 grid=[0.0] folder=; }
COMP_LINE="$2"; COMP_POINT=${#2}; _urbanjax_complete; printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("python -m experiments.plan ", ["preset=", "seed=", "vehicle.", "grid=", "folder="]),
        ("python -m experiments.plan preset=fast ve", ["vehicle."]),
        ("python -m experiments.plan vehicle.", ["vehicle.length=", "vehicle.width="]),
        ("python -m experiments.plan vehicle.length=", ["4.7"]),
        ("python -m experiments.plan preset=", ["fast", "short"]),
        ("python -m experiments.plan -m preset=s", ["short"]),
        ("python -m experiments.plan folder=", []),
        ("python -m experiments.pl", ["experiments.plan "]),
        ("python -m pytest te", []),
        ("python experiments/plan pre", []),
    ],
)
def test_bash_completes(line, found):
    command = ["bash", "--norc", "-c", SCRIPT, "bash", str(REPOSITORY / "configs" / "complete.bash"), line]
    done = subprocess.run(command, capture_output=True, text=True, cwd=REPOSITORY, timeout=60)
    assert done.stderr == ""
    assert done.stdout.split("\n")[: len(found)] == found
    assert done.stdout.strip() == "\n".join(found).strip()


def test_a_program_says_all_that_can_be_completed(run):
    done = run("-sc", "query=all")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    for line in (
        "preset=fast",
        "vehicle.length=4.7",
        "grid=[0.0,1.0]",
        "fail=true",
        "fail=false",
        "folder=",
        "--help ",
    ):
        assert line in lines


def test_choices_are_completed(tmp_path):
    (tmp_path / "preset").mkdir()
    (tmp_path / "preset" / "mine.yaml").touch()
    found = list(completions(StackParams(), folders=[tmp_path]))
    assert found[0] == "preset=mine"
    assert {"relaxation.mode=hard", "relaxation.mode=soft", "relaxation.mode=straight_through"} <= set(found)
