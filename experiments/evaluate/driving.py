"""Drive, and keep rows and logs part by part, so that a run that is cut off can go on."""

import json
import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from experiments.evaluate import study, tables
from experiments.evaluate.study import EvaluateStudy
from experiments.evaluate.tables import Rows
from urbanjax.evaluation.batch import Outcome
from urbanjax.evaluation.together import Batch
from urbanjax.evaluation.verdict import Cause
from urbanjax.io.runs import drive_logs, evaluations, processes
from urbanjax.io.runs.directory import Run, digest, git_state, write_atomically
from urbanjax.types import ConfigError


class MissionDrives:
    """The drives of one evaluation in the run's directory, and the rows that come of them."""

    def __init__(self, params: EvaluateStudy, run: Run) -> None:
        """Look up what is asked and what is there already, in the directory that `resume` names or in a job's own."""
        if params.replay or params.run or params.against:
            raise ConfigError("'replay', 'run' and 'against' look at drives that there are: leave them out of a sweep")
        self.params, self.run = params, run
        self.asked = study.missions_of(params)
        self.batches = study.batches(params, self.asked)
        self._parts = {part: batch for batch in self.batches for part in batch.parts}
        config, resolved = (
            {name: value for name, value in values.items() if name not in processes.OWN}
            for values in (run.config, run.resolved)
        )
        stamp = {"config": config, "config_sha256": digest(resolved)}
        stamp = stamp if run.swept else stamp | {"code": git_state()}  # a sweep's directory is named by its sources
        self._source = str(run.directory) if run.swept and (run.path("rows") / study.STAMP).exists() else params.resume
        self._rows = self._with_logs(study.known(self._source, stamp))
        for name in ("rows", drive_logs.FOLDER) if params.logs else ("rows",):
            run.path(name).mkdir(exist_ok=True)
        if params.process:
            return
        write_atomically(run.path("rows") / study.STAMP, json.dumps(stamp))
        for part, rows in self._rows.items() if self._source != str(run.directory) else ():
            self._write(part, rows, [])  # so that this run too can be gone on with

    def missing(self) -> dict[str, Batch]:
        """This process' share of what is to be driven."""
        first = int(self.run.job.get("job", 0))  # jobs of one part each are dealt out too
        mine = [
            part
            for number, part in enumerate(self._parts, first)
            if number % self.params.processes == self.params.process
        ]
        return {part: self._parts[part] for part in mine if part not in self._rows}

    def take(self, part: str, outcomes: Sequence[Outcome], later: Callable) -> None:
        """Keep the rows of a part, and write them while others drive. Args: part; outcomes; later, see `background`."""
        driver = self._parts[part].name.partition("-")[0]
        rows = [study.row_of(driver, one) for one in outcomes]
        self._rows[part] = rows = [{**row, "cause": label(row["cause"])} for row in rows]
        later(lambda: self._write(part, rows, outcomes))

    def rows(self) -> Rows:
        """All rows in the order of the drives; those of other processes are waited for."""
        files = {name: self._file(name) for name in self._parts if name not in self._rows}
        if files:
            print(f"waiting for {len(files)} parts of other processes", flush=True)
            processes.wait_for(list(files.values()), self.run)
        return [row for name in self._parts for row in self._rows.get(name) or study.rows_in(files[name])]

    def expected(self) -> list[tuple]:
        """What tells every drive that was asked for."""
        return [
            (batch.name.partition("-")[0], batch.traffic, job.mission.name, job.seed)
            for batch in self.batches
            for job in batch.jobs
        ]

    def finish(self) -> None:
        """Write rows and tables."""
        if not self.params.process:
            write_tables(self, self.rows())

    def _file(self, part: str) -> Path:
        return self.run.path("rows") / f"{part}.parquet"

    def _with_logs(self, done: dict[str, Rows]) -> dict[str, Rows]:
        """The parts whose logs are there too, where logs are wanted."""
        folder = Path(self._source) / drive_logs.FOLDER
        return {
            name: rows
            for name, rows in done.items()
            if name in self._parts and (not self.params.logs or (folder / f"{name}.parquet").is_file())
        }

    def _write(self, part: str, rows: Rows, ended: Sequence[Outcome]) -> None:
        """One part, the logs before the rows: where there are rows there are logs."""
        import pyarrow
        import pyarrow.parquet

        logs, file = self.run.path(drive_logs.FOLDER) / f"{part}.parquet", self._file(part)
        if self.params.logs and ended:
            drive_logs.write_logs(logs, rows[0]["driver"], outcomes=list(ended), vehicle=self.params.vehicle)
        elif self.params.logs:
            shutil.copyfile(Path(self._source) / drive_logs.FOLDER / logs.name, logs)
        part_file = Path(f"{file}.{os.getpid()}.part")
        pyarrow.parquet.write_table(pyarrow.table(tables.columns(rows)), part_file)
        part_file.rename(file)


def drive(found: MissionDrives) -> tuple[Rows, int, float]:
    """All rows, how many of them were driven here, and the seconds that it took; of process 0, none of the others'."""

    def ended(name: str, error: Exception | None) -> None:
        if error is not None:
            raise error

    count, seconds = evaluations.evaluate({"": found}, ended=ended)
    return ([] if found.params.process else found.rows()), count, seconds


def label(cause: Any) -> str:
    """A cause of failure by name. Args: cause, its number or its name already."""
    return cause if isinstance(cause, str) else Cause(cause).label


def write_tables(found: MissionDrives, rows: Rows) -> dict[str, dict[str, list[Any]]]:
    """Write rows, tables and summary into the run; returns the tables by name.

    A job of a sweep has no tables: the sweep has them. Args: found, the drives; rows, of all.
    """
    found.run.table("rows", tables.columns(rows))
    found.run.summary(tables.summary(rows))
    if found.run.swept:
        return {}
    columns = {
        "headline": tables.headline(rows),
        "missions": tables.by_mission(rows),
        "causes": tables.failures(rows),
        **{score: tables.parts(rows, score) for score in tables.scores(rows)},
        "localizations": tables.localizations(rows) if len(tables.names(rows, "localization")) > 1 else {},
        "orders": tables.orders(rows),
        "differences": tables.differences(rows),
        "coverage": tables.coverage(rows, found.expected()),
    }
    for name, table in columns.items():
        if table:
            found.run.table(name, table)
    return columns
