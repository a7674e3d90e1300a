"""Which drivers drive which missions among what traffic, and the rows that come of it."""

import dataclasses
import json
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from experiments.common import recordings
from urbanjax.drivers import DRIVERS, IdmDriver, PdmDriver
from urbanjax.evaluation import road_users
from urbanjax.evaluation.batch import Job, Outcome
from urbanjax.evaluation.case import Case
from urbanjax.evaluation.missions import MISSIONS, QUALIFICATION
from urbanjax.evaluation.missions.found import FoundMission, found_missions
from urbanjax.evaluation.missions.localized import GIVEN, LOCALIZATIONS, LocalizedMission, Roads
from urbanjax.evaluation.missions.mission import LONGEST, Mission
from urbanjax.evaluation.missions.recorded import RecordedMission, recorded_mission
from urbanjax.evaluation.together import Batch
from urbanjax.evaluation.traffic import MANNERS
from urbanjax.io.runs.found_file import read_found
from urbanjax.roadmap.corridor import CorridorParams
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.rollout import LoopParams
from urbanjax.sim.log import Log
from urbanjax.types import ConfigError, Unread, field, pytree, static
from urbanjax.types.unread import changed
from urbanjax.vehicle.params import VehicleParams

Asked = dict[str, Mission | LocalizedMission | RecordedMission | FoundMission]  # by name

RECORDED = "replay"  # the traffic of recordings
STAMP = "of.json"  # in the folder of rows: what they are of
DRIVEN = (
    *("vehicle", "period", "sim"),
    *(
        "missions",
        "found",
        "scenes",
        "drivers",
        "traffic",
        "localization",
        "seeds",
        "seed",
        "duration",
        "epdms",
        "worst",
        "resume",
    ),
    *("logs", "coordinator", "process", "processes"),
)
OF_SCENES = ("folder", "egos", "corridor")
WITH_KEYS = ("idm", "pdm")  # plain drivers whose params are keys


@pytree
class EvaluateStudy(LoopParams):
    """Missions x localization x seeds x drivers x traffic."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        **dict.fromkeys(("row", "before"), Unread("no row is driven again, see 'replay'", lambda p: not p.replay)),
        **dict.fromkeys(DRIVEN, Unread("nothing new is driven with 'replay' or 'run'", lambda p: p.replay or p.run)),
        **dict.fromkeys(
            ("seeds", "seed", "duration"),
            Unread("no mission is drawn, see 'missions'", lambda p: p.replay or p.run or not p.missions),
        ),
        **dict.fromkeys(OF_SCENES, Unread("no recording is driven in, see 'scenes'", lambda p: not p.scenes)),
        "stack.localizer": Unread("'localization' says whether it is given its pose"),
        **dict.fromkeys(
            ("stack.lidar", "stack.search", "sensor"),
            Unread(
                "poses are given, see 'localization'",
                lambda p: p.replay or p.run or set(p.localization) == {GIVEN},
            ),
        ),
        "shortest": Unread(
            "nobody recorded is replaced, see 'scenes' and 'egos'", lambda p: not p.scenes or p.egos == "problems"
        ),
        "stack": Unread(
            "the stack does not drive, see 'drivers', 'replay' and 'run'",
            lambda p: p.replay or p.run or not {"stack", "blind"} & set(p.drivers),
        ),
        **{
            name: Unread(
                f"'{name}' does not drive, see 'drivers', 'replay' and 'run'",
                lambda p, name=name: p.replay or p.run or name not in p.drivers,
            )
            for name in WITH_KEYS
        },
    }

    idm: IdmDriver = IdmDriver()
    pdm: PdmDriver = PdmDriver()
    missions: tuple[str, ...] = static(
        default=tuple(mission.name for mission in QUALIFICATION),
        metadata={"choices": tuple(MISSIONS), "may_be_empty": True},
    )
    found: str = static(default="", metadata={"path": True})  # file of encounters that a search for failures wrote
    scenes: tuple[str, ...] = static(default=())  # recordings (CommonRoad), driven in with traffic 'replay'
    folder: str = static(default="", metadata={"path": True})  # of them, by default that of the data beside
    egos: str = static(default="vehicles", metadata={"choices": recordings.EGOS})  # who is driven there
    shortest: float = field(default=3.0, metadata={"range": (0.2, 1e4)})  # s that a recorded drive lasts
    corridor: CorridorParams = CorridorParams()  # along recorded routes
    drivers: tuple[str, ...] = static(default=("stack",), metadata={"choices": tuple(DRIVERS)})
    traffic: tuple[str, ...] = static(default=("idm",), metadata={"choices": tuple(MANNERS)})
    localization: tuple[str, ...] = static(default=(GIVEN,), metadata={"choices": (GIVEN, *LOCALIZATIONS)})
    seeds: int = static(default=256, metadata={"range": (1, 10**5)})  # drives of each mission
    seed: int = static(default=0, metadata={"range": (0, 2**31)})  # the first one
    duration: float = static(default=LONGEST, metadata={"range": (1.0, LONGEST)})  # s, after which a drive is too late
    epdms: bool = static(default=False)  # rows hold this score too, for which `pdm` drives beside everybody
    worst: int = static(default=10, metadata={"range": (0, 1000)})  # drives shown as pictures
    logs: bool = static(default=False)  # whether the logs of all drives are written too, as Parquet
    coordinator: str = static(default="")  # HOST:PORT of process 0, where several share the drives; none: one process
    process: int = static(default=0, metadata={"range": (0, 10**4)})  # number of this one
    processes: int = static(default=1, metadata={"range": (1, 10**4)})
    resume: str = static(default="", metadata={"path": True})  # directory of a run of the same config that was cut off
    run: str = static(default="", metadata={"path": True})  # directory of a run, to be compared instead of driving
    against: str = static(default="", metadata={"path": True})  # directory of another one
    replay: str = static(default="", metadata={"path": True})  # directory of a run of which one drive is driven again
    row: int = static(default=0, metadata={"range": (0, 10**9)})  # which one, counted in its rows.csv from 0
    before: float = field(default=1.0, metadata={"range": (0.0, 30.0)})  # s before its cause, asked of the driver


def loop_of(study: EvaluateStudy, driver: str) -> LoopParams:
    """The closed loop of one driver."""
    loop = study.loop()
    if driver == "stack":
        return loop
    if driver == "blind":
        return loop.replace(driver=DRIVERS[driver](stack=study.stack))
    return loop.replace(driver=getattr(study, driver) if driver in WITH_KEYS else DRIVERS[driver]())


def jobs_of(study: EvaluateStudy, asked: Asked, traffic: str) -> list[Job]:
    """The drives of one driver in one kind of traffic. Args: asked, the missions by name."""
    seeds = range(study.seed, study.seed + study.seeds)
    numbered = RecordedMission, FoundMission
    drawn = [Job(one, seed) for one in asked.values() if not isinstance(one, numbered) for seed in seeds]
    drawn += [Job(one, k) for one in asked.values() if isinstance(one, FoundMission) for k in range(one.count)]
    scenes = [one for one in asked.values() if isinstance(one, RecordedMission)]
    return drawn + [Job(one, k) for one in scenes if traffic == RECORDED for k in range(one.count)]


def missions_of(study: EvaluateStudy) -> Asked:
    """What is driven, by name. Raises ConfigError for files that are missing or cannot be driven in.

    Raises FileError where there is no file of found encounters, and ScenarioError for a planning problem whose goal is
    no station of its route.
    """
    if set(study.localization) != {GIVEN} and (study.scenes or set(study.drivers) != {"stack"}):
        raise ConfigError(
            f"'localization' is {list(study.localization)}: nobody but the stack finds its pose, and no recording has "
            "surroundings; ask 'drivers=[stack]' without 'scenes'"
        )
    roads = Roads(study.sensor)
    found: Asked = {}
    for how in study.localization:
        for mission in (dataclasses.replace(MISSIONS[name], longest=study.duration) for name in study.missions):
            one = mission if how == GIVEN else LocalizedMission(mission, how, roads)
            found[one.name] = one
    found |= {one.name: one for one in (found_missions(read_found(study.found)) if study.found else ())}
    for path in recordings.paths(study.scenes, study.folder, key="scenes") if study.scenes else ():
        road = recordings.read(path, study.period, key="scenes")
        scene = recordings.scene_of(
            road, study.corridor, egos=study.egos, shortest=study.shortest, vehicle=study.vehicle
        )
        found[scene.name] = recorded_mission(scene)
    if not found:
        raise ConfigError("nothing is asked: name 'missions', 'found' or 'scenes'")
    if study.scenes and RECORDED not in study.traffic:
        raise ConfigError(f"recordings are driven in as they were: add {RECORDED!r} to 'traffic', or ask no 'scenes'")
    return found


def batches(study: EvaluateStudy, asked: Asked) -> list[Batch]:
    """The drives by driver and traffic, whose names are their batch's. Args: asked, the missions by name."""
    return [
        Batch(
            f"{driver}-{traffic}",
            (loop_of(study, driver),),
            tuple(jobs),
            traffic=traffic,
            logs=study.logs,
            epdms=study.epdms,
        )
        for driver in dict.fromkeys(study.drivers)
        for traffic in dict.fromkeys(study.traffic)
        if (jobs := jobs_of(study, asked, traffic))
    ]


def row_of(driver: str, outcome: Outcome) -> dict[str, Any]:
    """The row of one drive."""
    return {"driver": driver, **{name: plain(value) for name, value in outcome.row.items()}}


def until_end(outcome: Outcome, case: Case, own: VehicleParams) -> tuple[Log, RoadGraph, VehicleParams]:
    """The log until the drive ends, the road, and the vehicle. Args: own, where the case has none of its own."""
    return road_users.until_end(outcome), case.lanes.graph, case.vehicle or own


def plain(value: Any) -> Any:
    """A NumPy scalar as Python's own."""
    return value.item() if isinstance(value, np.generic | np.ndarray) else value


def rows_in(path: Path) -> list[dict[str, Any]]:
    """The rows of one file. Args: path of it."""
    import pyarrow.parquet

    return pyarrow.parquet.read_table(path).to_pylist()


def rows_of(directory: str, key: str) -> list[dict[str, Any]]:
    """The rows of a run. Args: directory; key, that named it. Raises ConfigError where there are none."""
    path = Path(directory) / "rows.parquet"
    if not path.is_file():
        raise ConfigError(f"{key}={directory}: there is no {path.name} in it; name the directory of an evaluation")
    return rows_in(path)


def known(resume: str, stamp: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """The rows of a run that was cut off, by the names of its parts. Args: resume, its directory; stamp, of this run.

    Raises ConfigError for a run of another config or of other code: their drives do not belong together.
    """
    if not resume:
        return {}
    folder = Path(resume) / "rows"
    try:
        theirs = json.loads((folder / STAMP).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(f"resume={resume}: there is no {folder / STAMP}; name an evaluation's directory") from error
    ours = json.loads(json.dumps(stamp))
    for key in ours:
        differs = sorted(changed(ours[key], theirs.get(key, {}))) if isinstance(ours[key], dict) else [key]
        if ours[key] != theirs.get(key):
            what = "value behind a ${...} of its config" if key == "config_sha256" else ", ".join(differs[:3]) or key
            raise ConfigError(f"resume={resume}: that run was of another {what}; begin anew")
    return {path.stem: rows_in(path) for path in sorted(folder.glob("*.parquet"))}
