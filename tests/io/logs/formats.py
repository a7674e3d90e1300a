"""Formats of real logs as configs state them, and small files of each kind."""

import json

import numpy as np

from urbanjax.io.logs import LogFormat
from urbanjax.types.config import to_params

OPENACC = {
    "columns": {"time": "Time", "x": "E{i}", "y": "N{i}", "speed": "Speed{i}"},
    "layout": "wide",
    "preamble": 5,
    "vehicles": "Vehicle_order",
    "path": "{run}",
}
F1 = {
    "columns": {"time": "tel.time", "x": "tel.x", "y": "tel.y", "speed": "tel.speed"},
    "units": {"position": "dm", "speed": "km/h"},
    "path": "{team}/{run}_tel",
}
LONG = {
    "columns": {"time": "t", "x": "x", "y": "y", "speed": "v", "heading": "psi", "vehicle": "id", "team": "group"},
    "units": {"time": "ms", "position": "ft", "speed": "mph", "heading": "deg", "compass": True},
    "layout": "long",
}


def form(values, **changes):
    return to_params(LogFormat, {**values, **changes})


def drive(n=40, dt=0.1, speed=12.0, radius=80.0, start=5.0):
    """Time s, position m, speed m/s and heading rad of a drive along an arc to the left."""
    time = start + dt * np.arange(n)
    turn = speed * dt * np.arange(n) / radius
    position = radius * np.stack([np.sin(turn), 1 - np.cos(turn)], -1)
    return time, position, np.full(n, speed), turn


def wide(cars=2, n=12):
    """A file of openACC's kind in which vehicle 2 of three has no columns."""
    time, position, speed, _ = drive(n)
    numbers = [1, 3, 4, 5][:cars]
    head = ["Date,9,10,2019", "Vehicle_order,ALFA,BRAVO,CHARLIE,DELTA,ECHO,", "Number_of_vehicles,5", "ACC,1", "Set,S"]
    names = [f"{c}{i}" for i in numbers for c in ("Speed", "E", "N")]
    rows = [
        [f"{time[k]:.1f}", *(f"{v:.6f}" for i in numbers for v in (speed[k], position[k, 0] - 9 * i, position[k, 1]))]
        for k in range(n)
    ]
    return "\n".join([*head, ",".join(["Time", *names]), *(",".join(row) for row in rows), ""])


def telemetry(n=12):
    """A file of the f1 kind."""
    time, position, speed, _ = drive(n)
    columns = {"time": time, "x": 10 * position[:, 0], "y": 10 * position[:, 1], "speed": 3.6 * speed}
    return json.dumps({"tel": {**{k: v.tolist() for k, v in columns.items()}, "dataKey": "made"}})


def long(n=8):
    """Columns of two vehicles, their rows mixed, in feet, mph, milliseconds and compass degrees."""
    time, position, speed, heading = drive(n)
    columns = {"t": 1000 * time, "id": ["a"] * n, "group": ["red"] * n}
    columns |= {"x": position[:, 0] / 0.3048, "y": position[:, 1] / 0.3048}
    columns |= {"v": speed / 0.44704, "psi": 90 - np.degrees(heading)}
    other = {**columns, "id": ["7"] * n, "group": ["blue"] * n, "x": columns["x"] + 100}
    order = np.arange(2 * n).reshape(2, n).T.ravel()
    return {k: [[*columns[k], *other[k]][j] for j in order] for k in columns}


def csv_text(columns):
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(columns), *(",".join(str(v) for v in row) for row in rows), ""])


def write(folder, content, name):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content) if isinstance(content, bytes) else path.write_text(content)
    return path
