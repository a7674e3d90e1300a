"""Drive, and keep rows and logs chunk by chunk, so that a run that is cut off can go on."""

import json
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from experiments.evaluate import study, tables
from experiments.evaluate.study import Asked, EvaluateStudy
from experiments.evaluate.tables import Rows
from urbanjax.evaluation.batch import Outcome
from urbanjax.evaluation.verdict import Cause
from urbanjax.io.runs import drive_logs, processes, progress
from urbanjax.io.runs.background import background
from urbanjax.io.runs.directory import Run, git_state, write_atomically

APART = ("resume", *processes.KEYS)  # keys that change nothing in the rows


def drive(params: EvaluateStudy, run: Run, asked: Asked) -> tuple[Rows, int, float]:
    """All rows, how many of them were driven, and the seconds that it took; chunks are written as they are complete.

    Of several processes each drives its share; the first one then waits for the others and has the rows of all.
    """
    config = {name: value for name, value in run.config.items() if name not in APART}
    stamp = {"config": config, "code": git_state()}
    done = _with_logs(params, study.known(params.resume, stamp))
    for name in ("rows", drive_logs.FOLDER) if params.logs else ("rows",):
        run.path(name).mkdir(exist_ok=True)
    if not params.process:
        write_atomically(run.path("rows") / study.STAMP, json.dumps(stamp))
    found: dict[str, Rows] = {}
    began = time.perf_counter()
    with progress.bar("evaluation") as tick:

        def paced(label: str, share: float) -> None:
            passed = time.perf_counter() - began
            left = f", {passed / share - passed:.0f} s left" if share > 0 else ""
            tick(f"{label}, {sum(map(len, found.values())) / passed:.1f} drives/s{left}", share)

        with background() as later:
            for name, part, ended in study.drives(params, asked, done, paced):
                part = [{**row, "cause": label(row["cause"])} for row in part]
                if ended or not params.process:  # what was known is written by the first process
                    later(lambda name=name, part=part, ended=ended: _write(params, run, name, part, ended))
                found[name] = part
        rows = _joined(params, run, asked, found, tick) if not params.process else []
    return rows, len(rows) - sum(map(len, done.values())), time.perf_counter() - began


def _joined(params: EvaluateStudy, run: Run, asked: Asked, found: dict[str, Rows], tick: Callable[..., None]) -> Rows:
    """The rows of all processes in the order of the drives."""
    names = [name for named in study.chunks(params, asked).values() for name in named]
    files = {name: run.path("rows") / f"{name}.parquet" for name in names if name not in found}
    processes.wait_for(list(files.values()), run, tick=lambda count: tick(f"{count} chunks of other processes"))
    found = found | {name: study.rows_in(path) for name, path in files.items()}
    return [row for name in names for row in found[name]]


def label(cause: Any) -> str:
    """A cause of failure by name. Args: cause, its number or its name already."""
    return cause if isinstance(cause, str) else Cause(cause).label


def _with_logs(params: EvaluateStudy, done: dict[str, Rows]) -> dict[str, Rows]:
    """The chunks whose logs are there too, where logs are wanted."""
    folder = Path(params.resume) / drive_logs.FOLDER
    return {name: rows for name, rows in done.items() if not params.logs or (folder / f"{name}.parquet").is_file()}


def _write(params: EvaluateStudy, run: Run, name: str, rows: Rows, ended: list[Outcome]) -> None:
    """One chunk, the logs before the rows: where there are rows there are logs."""
    import pyarrow
    import pyarrow.parquet

    logs, file = run.path(drive_logs.FOLDER) / f"{name}.parquet", run.path("rows") / f"{name}.parquet"
    if params.logs and ended:
        drive_logs.write_logs(logs, rows[0]["driver"], outcomes=ended, vehicle=params.vehicle)
    elif params.logs:
        shutil.copyfile(Path(params.resume) / drive_logs.FOLDER / logs.name, logs)
    pyarrow.parquet.write_table(pyarrow.table(tables.columns(rows)), f"{file}.part")
    Path(f"{file}.part").rename(file)
