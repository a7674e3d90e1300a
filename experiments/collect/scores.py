"""What jobs are compared by: means over drives, differences of the same drives, or entries of summaries."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.collect.axes import is_number
from experiments.collect.study import CollectStudy
from experiments.collect.sweeps import SweepJob
from experiments.common.scenes import base, scenes
from urbanjax.evaluation import statistics
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.io.runs.directory import COMPLETE
from urbanjax.types import ConfigError, config, host_record

START = ("driver", "traffic", "localization", "mission", "seed")  # what a drive is one of
# Axes on which the drives of jobs differ in what names them, and are yet drives from the same starts.
OF_NAMES = {"drivers": "driver", "traffic": "traffic", "localization": "localization"}
FIRST, SECOND = "nuplan_total", "success"  # of rows, where nothing is asked
NOBODY = WithInterval(np.nan, np.nan, np.nan)
NONE = "-"


@host_record
class SweepScore:
    """A score by name, and whether more of it is better."""

    name: str
    more: bool

    @property
    def sign(self) -> float:
        """What makes more better."""
        return 1.0 if self.more else -1.0

    @property
    def told(self) -> str:
        """In words."""
        return f"{self.name} ({'more' if self.more else 'less'} is better)"


@host_record
class JobDrives:
    """The drives of one job."""

    starts: tuple[tuple, ...]  # what each is, by START
    scene: np.ndarray  # [N] the road or recording of each
    values: Mapping[str, np.ndarray]  # [N] by score


class Evidence:
    """The drives of jobs by title, and the numbers over them; without drives, those of the summaries."""

    def __init__(self, jobs: Sequence[SweepJob], names: Sequence[str]):
        """Read the rows of the complete jobs. Args: jobs; names of scores."""
        self.drives: dict[str, JobDrives] = {}
        self.unreadable: dict[str, str] = {}
        self._known: dict[tuple[str, str], WithInterval] = {}
        for job in jobs:
            if job.status == COMPLETE and (job.folder / "rows.parquet").is_file():
                self._read(job, names)

    def _read(self, job: SweepJob, names: Sequence[str]) -> None:
        import pyarrow
        import pyarrow.parquet

        path = job.folder / "rows.parquet"
        try:
            with pyarrow.parquet.ParquetFile(path) as file:
                columns = [name for name in dict.fromkeys((*START, *names)) if name in file.schema_arrow.names]
                rows = file.read(columns=columns).to_pylist()
            scene = scenes(rows)
            starts = tuple((*(row[name] for name in START[:3]), base(row), row["seed"]) for row in rows)
            values = {name: np.array([_float(row[name]) for row in rows]) for name in names if name in columns}
        except (OSError, KeyError, TypeError, ValueError, pyarrow.ArrowException) as error:
            why = " ".join(str(error).split())
            self.unreadable[job.title] = f"{path}: cannot be read as rows of drives ({type(error).__name__}: {why})"
            return
        if rows:
            self.drives[job.title] = JobDrives(starts, scene, values)

    def of(self, job: SweepJob, name: str) -> WithInterval:
        """A score of one job, NaN where it has none or where it is not finite in all drives. Args: job; name."""
        if (job.title, name) not in self._known:
            drives = self.drives.get(job.title)
            if drives and name in drives.values:
                self._known[job.title, name] = self._over([drives], name)
            else:
                ends = (f"{name}{end}" for end in ("", "_low", "_high"))
                self._known[job.title, name] = WithInterval(*(_float(job.summary.get(entry)) for entry in ends))
        return self._known[job.title, name] if job.status == COMPLETE else NOBODY

    def over(self, jobs: Sequence[SweepJob], name: str) -> WithInterval:
        """The mean of a score over jobs that have it.

        The interval is of drives: whole scenes are drawn, with the drives of all jobs on them. Without drives it is the
        mean of the jobs' own, as wide as if their errors were one. Args: jobs; name.
        """
        known = [job for job in jobs if np.isfinite(self.of(job, name).value)]
        drives = [self.drives[job.title] for job in known if job.title in self.drives]
        drives = [part for part in drives if name in part.values]
        if not known or (drives and len(drives) == len(known)):
            return self._over(drives, name) if drives else NOBODY
        return WithInterval(*np.mean([self.of(job, name) for job in known], axis=0).tolist())

    def _over(self, drives: Sequence[JobDrives], name: str) -> WithInterval:
        values, scene = (
            np.concatenate(parts) for parts in zip(*((d.values[name], d.scene) for d in drives), strict=True)
        )
        if not np.isfinite(values).all():
            return NOBODY
        if name == SECOND and len(drives) == 1:
            return statistics.rate(values.astype(bool))
        if name == SECOND and np.ptp(values) == 0:  # drawing says nothing; what several jobs drive is known once
            return statistics.rate(values[: len({start for part in drives for start in part.starts})].astype(bool))
        return statistics.mean(values, groups=scene)

    def counts(self, job: SweepJob) -> tuple[int, int]:
        """How many drives there are of a job, and on how many roads or recordings. Args: job."""
        drives = self.drives.get(job.title)
        return (len(drives.scene), len(np.unique(drives.scene))) if drives else (0, 0)

    def difference(
        self, pairs: Sequence[tuple[SweepJob, SweepJob]], name: str, *, axis: str = ""
    ) -> tuple[WithInterval, int]:
        """The mean difference over the drives that both jobs of each pair have, ours less theirs; and their number.

        Args: pairs, ours and theirs; name of the score; axis, key on which they differ: what it says of a drive's name
        is not compared.
        """
        found = [self._pairs(ours, theirs, name, OF_NAMES.get(axis, "")) for ours, theirs in pairs]
        found = [part for part in found if part is not None and len(part[0])]
        if not found:
            return NOBODY, 0
        less, scene = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return statistics.mean(less, groups=scene), len(less)

    def _pairs(self, ours: SweepJob, theirs: SweepJob, name: str, apart: str) -> tuple[np.ndarray, np.ndarray] | None:
        both = [self.drives[job.title] for job in (ours, theirs) if job.title in self.drives]
        if len(both) < 2 or any(not np.isfinite(part.values.get(name, np.nan)).all() for part in both):
            return None
        one, other = ({_start(start, apart): i for i, start in enumerate(part.starts)} for part in both)
        if len(one) < len(both[0].starts) or len(other) < len(both[1].starts):
            return None  # a start is driven twice: nobody knows which belong together
        shared = [(i, other[start]) for start, i in one.items() if start in other]
        i, j = np.array(shared, int).reshape(-1, 2).T
        return both[0].values[name][i] - both[1].values[name][j], both[0].scene[i]


def _start(start: tuple, apart: str) -> tuple:
    return tuple(part for part, name in zip(start, START, strict=True) if name != apart)


def _float(value: Any) -> float:
    return float(value) if isinstance(value, bool) or is_number(value) else np.nan


def names_in(jobs: Sequence[SweepJob]) -> tuple[list[str], list[str]]:
    """Names of scores: numeric columns of rows, and entries of summaries. Args: jobs."""
    import pyarrow
    import pyarrow.parquet

    columns: dict[str, None] = {}
    for job in jobs:
        path = job.folder / "rows.parquet"
        if job.status == COMPLETE and path.is_file():
            try:
                schema = pyarrow.parquet.read_schema(path)
            except (OSError, pyarrow.ArrowException):
                continue  # said where the rows themselves are read
            kinds = pyarrow.types
            numeric = (kinds.is_floating, kinds.is_integer, kinds.is_boolean)
            columns |= dict.fromkeys(
                f.name for f in schema if any(of(f.type) for of in numeric) and f.name not in START
            )
    entries = dict.fromkeys(name for job in jobs if job.status == COMPLETE for name in job.summary)
    return list(columns), list(entries)


def chosen(params: CollectStudy, jobs: Sequence[SweepJob]) -> list[SweepScore]:
    """The scores that jobs are compared by: what is best, and what it is weighed against if anything.

    Where nothing is asked: `nuplan_total` against `success` where jobs have rows with these, else the first two entries
    of summaries that have intervals. Args: jobs of one experiment. Raises ConfigError for a score that no job has.
    """
    columns, entries = names_in(jobs)
    known = [name for name in entries if f"{name}_low" in entries and f"{name}_high" in entries]
    preferred = [name for name in (FIRST, SECOND) if name in columns] + known
    asked: list[SweepScore] = []
    for key, direction in (("score", params.best), ("against", params.best_against)):
        name = getattr(params, key)
        if name and name != NONE and name not in {*columns, *entries} and (columns or entries):
            raise ConfigError(f"{key}={name}: no job has such a score{config.nearest(name, [*columns, *entries])}")
        name = name or next((each for each in preferred if each not in [score.name for score in asked]), NONE)
        if name != NONE and name not in [score.name for score in asked]:
            asked.append(SweepScore(name, direction == "most"))
    return asked


def ranked(jobs: Sequence[SweepJob], evidence: Evidence, score: SweepScore) -> list[SweepJob]:
    """The jobs that have the score, best first; as planned where they are alike. Args: jobs; evidence; score."""
    found = [(evidence.of(job, score.name).value, job) for job in jobs]
    return [job for _, job in sorted((p for p in found if np.isfinite(p[0])), key=lambda p: -score.sign * p[0])]
