"""A picture of any map and what looks wrong in it."""

import time

from experiments.map.study import MapStudy
from urbanjax.io import maps
from urbanjax.io.figures.maps import draw_map
from urbanjax.io.maps import validity
from urbanjax.io.runs.directory import Run
from urbanjax.types import ConfigError


def write(params: MapStudy, run: Run) -> None:
    """Read the map; write map.png, faults.csv and the report's text into the run, and print it."""
    if not params.file:
        raise ConfigError("file is empty: name a map, as in file=PATH")
    start = time.perf_counter()
    found = maps.read(params.file)
    seconds = time.perf_counter() - start
    report = validity.report(found)
    draw_map(found, run.path("map.png"))
    columns = {key: [str(getattr(fault, key)) for fault in report.faults] for key in ("kind", "lane", "detail")}
    run.table("faults", columns)
    run.path("validity.txt").write_text(report.text() + "\n", encoding="utf-8")
    counts = {name.replace(" ", "_"): count for name, count in report.counts.items()}
    run.summary({**counts, "length_m": report.length, "faults": len(report.faults), "read_s": seconds})
    print(f"{found.path.name} ({found.format})\n{report.text()}")
