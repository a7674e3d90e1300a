"""Logs of drives as Parquet: a file for each chunk of drives, a row group for each drive."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from urbanjax.evaluation.batch import Outcome
from urbanjax.evaluation.road_users import SHAPES, Driven, as_columns, driven, from_columns
from urbanjax.types import ConfigError
from urbanjax.vehicle.params import VehicleParams

FOLDER = "logs"  # in the directory of a run
KEY = ("driver", "traffic", "mission", "seed")  # what tells drives apart
FLOATS = ("time", *SHAPES)


def write_logs(path: Path, driver: str, *, outcomes: Iterable[Outcome], vehicle: VehicleParams) -> None:
    """Write who was where in some drives until their ends, whole or not at all; float32 as in their logs.

    Args: path of the file; driver, its name; outcomes, of the drives, with logs; vehicle, the ego's dimensions [m].
    """
    import pyarrow
    import pyarrow.parquet

    types = {"driver": pyarrow.string(), "traffic": pyarrow.string(), "mission": pyarrow.string()}
    types |= {"seed": pyarrow.int64(), "step": pyarrow.int32(), "object": pyarrow.int32()}
    types |= {**dict.fromkeys(FLOATS, pyarrow.float32()), "kind": pyarrow.int8(), "valid": pyarrow.bool_()}
    schema = pyarrow.schema(types)
    part = path.with_name(f"{path.name}.part")
    whole: Any = [name for name in types if name not in FLOATS and name != "valid"]
    with pyarrow.parquet.ParquetWriter(part, schema, compression="zstd", use_dictionary=whole) as writer:
        for one in outcomes:
            columns = as_columns(driven(one, vehicle))
            columns["kind"] = columns["kind"].astype(np.int8)
            rows = len(columns["step"])
            key = (driver, one.row["traffic"], one.job.mission.name, one.job.seed)
            named = {
                name: pyarrow.repeat(pyarrow.scalar(value, types[name]), rows)
                for name, value in zip(KEY, key, strict=True)
            }
            writer.write_table(pyarrow.table({**named, **columns}, schema=schema))
    part.rename(path)


def read_log(directory: str | Path, driver: str, *, mission: str, seed: int, traffic: str = "idm") -> Driven:
    """One drive of a run that kept its logs (`logs=true`).

    Args: directory of the run; driver, mission and traffic by name, and seed, as in its rows. Raises ConfigError where
    it is not there.
    """
    import pyarrow.dataset

    folder = Path(directory) / FOLDER
    files = sorted(folder.glob(f"{driver}-{traffic}-*.parquet"))
    if not files:
        raise ConfigError(f"{folder} has no logs of {driver!r} in {traffic!r} traffic: drive with logs=true")
    asked = (pyarrow.dataset.field("mission") == mission) & (pyarrow.dataset.field("seed") == seed)
    table = pyarrow.dataset.dataset([str(path) for path in files]).to_table(filter=asked)
    if not len(table):
        raise ConfigError(f"{folder} has no drive of {driver!r} in {traffic!r} traffic, {mission!r}, seed {seed}")
    return from_columns({name: table[name].to_numpy() for name in table.column_names if name not in KEY})
