"""What a user of the traffic experiment gets wrong: one line that names file or key and what to do, exit code 2."""

import re

import pytest

from tests.experiments import drives
from tests.experiments.drives import LAPS, OFFSET, WIDE, run


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    root = tmp_path_factory.mktemp("mistakes")
    drives.line(root)
    still = drives.laps(4, count=1)
    still = {**still, "x": 0 * still["x"], "y": 0 * still["y"], "v": 0 * still["v"]}
    drives.team(root / "spoilt", "grey", still)
    for name, seed in (("red", 1), ("blue", 2), ("green", 3)):
        drives.team(root / "teams", name, drives.laps(seed))
    drives.save(root / "empty" / "a.csv", {})
    drives.platoon(root / "road", "alone", (1.0,))
    return root


WRONG = {
    "no file": (("files=[teams/nobody/*.csv]", *LAPS), r"teams/nobody/\*\.csv: no file has such a name"),
    "empty file": (("files=[empty/a.csv]", *LAPS), r"empty/a\.csv: is empty"),
    "column": (
        ("files=[teams/*/*.csv]", *LAPS, "format.columns.x=X_m"),
        r"teams/blue/1\.csv: column 'X_m' is missing; .*x",
    ),
    "units": (
        ("files=[teams/*/*.csv]", *LAPS, "format.units.speed=km/h"),
        r"teams/blue/1\.csv: column 'v': .*units\.speed=m/s",
    ),
    "one team": (("files=[teams/red/*.csv]", *LAPS), "two teams or more; the logs have red"),
    "all frozen": (("files=[spoilt/grey/*.csv]", *LAPS), "every log is frozen"),
    "one vehicle": (("files=[road/alone.csv]", *WIDE), r"road/alone\.csv: a platoon has two vehicles or more"),
    "no line": (
        ("files=[teams/*/*.csv]", *LAPS, "course.line=''", "course.align=true"),
        "'course.align' needs the line .* set 'course.line'",
    ),
    "lost line": (
        ("files=[teams/*/*.csv]", *LAPS, "course.line=lost.csv"),
        r"'course\.line': there is no file lost\.csv",
    ),
    "k": (
        ("files=[teams/*/*.csv]", *LAPS, "teams.divergence.ks=[300]"),
        r"'teams\.divergence\.ks': (blue|green|red) has \d+ samples, too few for k = 300; take a smaller k",
    ),
    "area": (
        ("files=[teams/*/*.csv]", *LAPS, "course.areas=[north:0]"),
        r"'course\.areas': 'north:0' is not name:from:to",
    ),
    "area off": (
        ("files=[teams/*/*.csv]", *LAPS, "course.areas=[north:0:900]"),
        "area 'north': end is 900.* from 0 to 150",
    ),
    "area twice": (
        ("files=[teams/*/*.csv]", *LAPS, "course.areas=[a:0:9,a:9:20]"),
        "area 'a': give every area a name of its own",
    ),
    "key": (("teams.spacin=1",), "unknown key 'teams.spacin' .* the nearest valid key is 'teams.spacing'"),
    "analysis": (("analysis=team",), "'analysis' must be one of teams, platoons, offset"),
    "spacing": ((*OFFSET, "offset.spacings=[0.0]"), r"offset\.spacings"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_mistake_is_one_line_that_says_what_to_do(home, name):
    arguments, message = WRONG[name]
    done = run(home, *arguments)
    assert done.code == 2
    assert done.err.startswith("error: ")
    assert done.err.count("\n") == 1
    assert re.search(message, done.err), done.err
