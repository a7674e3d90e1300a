"""A picture of any map and what looks wrong in it: `python -m experiments.map file=PATH`."""

import time

from urbanjax.io import cli, maps
from urbanjax.io.maps import validity
from urbanjax.io.maps.figure import draw_map
from urbanjax.io.runs import Run
from urbanjax.types import ConfigError, pytree, static


@pytree
class MapStudy:
    """Which map."""

    file: str = static(default="")  # CommonRoad XML, Lanelet2 OSM or SUMO net XML


@cli.experiment("map", MapStudy)
def main(params: MapStudy, run: Run) -> None:
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


if __name__ == "__main__":
    main()
