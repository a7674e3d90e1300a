"""Made-up logs of a round course and of platoons, and the traffic experiment run on them within this process."""

import contextlib
import csv
import io
import json
import re
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from experiments.traffic import __main__ as traffic

RADIUS = 24.0  # m, of the course
LENGTH = 2 * np.pi * RADIUS  # m
SPEED = 12.0  # m/s
SMALL = ("teams.resampling.draws=4", "teams.resampling.blocks=4", "teams.deals=4")
FEW = ("platoon.resampling.draws=10",)
COLUMNS = "format.columns={time: t, x: x, y: y, speed: v}"
BASE = (*SMALL, "teams.divergence.ks=[5]", "course.line=line.csv", "course.areas=[north:0:70,south:70:140]")
PATH = "format.path='{team}/{run}'"
LAPS = (*BASE, COLUMNS, PATH)
SPREAD = "format.columns={time: t, x: 'x{i}', y: 'y{i}', speed: 'v{i}'}"
WIDE = (*FEW, PATH, SPREAD, "analysis=platoons", "format.layout=wide")
OFFSET = ("analysis=offset", "offset.teams=3", "offset.length=60", "offset.spacings=[1.0,0.1]", "offset.ks=[1]")


class Done(NamedTuple):
    """How a run ended and what it left."""

    code: int
    out: str
    err: str
    home: Path
    directory: Path

    @property
    def summary(self) -> dict:
        """Numbers by name."""
        return json.loads((self.directory / "summary.json").read_text())

    def table(self, name: str) -> list[dict[str, str]]:
        """Rows of a table, by column."""
        with open(self.directory / f"{name}.csv", newline="") as file:
            return list(csv.DictReader(file))


def run(home: Path, *arguments: str) -> Done:
    """The experiment as typed in a folder."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        patch.chdir(home)
        patch.setenv("HYDRA_FULL_ERROR", "1")
        patch.setenv("COLUMNS", "200")
        patch.setattr(sys, "argv", ["traffic", *arguments])
        try:
            traffic.main()
        except SystemExit as stop:
            code = int(stop.code or 0)
    named = re.search(r"run directory: (.*)\n\Z", out.getvalue())
    return Done(code, out.getvalue(), err.getvalue(), home, home / (named[1] if named else "nowhere"))


def line(home: Path) -> None:
    """`line.csv`, the middle of the course, counter-clockwise."""
    angle = 2 * np.pi * np.arange(200) / 200
    rows = np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), 5 + 0 * angle, 5 + 0 * angle], axis=1)
    save(home / "line.csv", dict(zip(("# x_m", "y_m", "w_tr_right_m", "w_tr_left_m"), rows.T, strict=True)))


def laps(seed: int, left: float = 0.0, count: int = 3) -> dict[str, np.ndarray]:
    """Columns t, x, y, v of laps in one go, each with smooth deviations of 0.3 m of its own about `left` m."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, count * LENGTH / SPEED - 0.05, 0.1)
    angle = SPEED * t / RADIUS
    lap = np.minimum((angle / (2 * np.pi)).astype(int), count - 1)
    order = np.arange(1, 5)
    waves = rng.normal(size=(count, 4, 2))[lap]
    smooth = waves[..., 0] * np.sin(order * angle[:, None]) + waves[..., 1] * (1 - np.cos(order * angle[:, None]))
    radius = RADIUS - left + 0.15 * smooth.sum(1)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    v = np.hypot(np.gradient(x, t), np.gradient(y, t))
    return {"t": t, "x": x, "y": y, "v": v, "lap": lap}


def team(home: Path, name: str, drive: dict[str, np.ndarray]) -> None:
    """`{name}/{lap}.csv`, one file per lap, each with a clock of its own."""
    for lap in np.unique(drive["lap"]):
        part = {key: drive[key][drive["lap"] == lap] for key in "txyv"}
        save(home / name / f"{lap + 1}.csv", {**part, "t": part["t"] - part["t"][0]})


def platoon(home: Path, name: str, gains: tuple[float, ...]) -> None:
    """`{name}.csv`, wide: vehicles in file on a straight road, whose speeds deviate by 0.71 m/s times a gain."""
    t = np.arange(0.0, 60.0, 0.1)
    wave = np.sin(2 * np.pi * t / 10)
    columns = {"t": t}
    for i, gain in enumerate(gains, 1):
        columns[f"x{i}"] = 10 * t - 25 * i - gain * 10 / (2 * np.pi) * np.cos(2 * np.pi * t / 10)
        columns[f"y{i}"] = 0 * t
        columns[f"v{i}"] = 10 + gain * wave
    save(home / f"{name}.csv", columns)


def save(path: Path, columns: dict[str, np.ndarray]) -> None:
    """Columns as CSV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(str(v) for v in row) for row in rows), ""]))
