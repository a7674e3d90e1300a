"""Missions on poses from scans: what fails is what is said, drawn from the seed, and the rest is the mission's."""

import dataclasses

import jax
import numpy as np
import pytest

from urbanjax.drivers import IdmDriver
from urbanjax.evaluation import whereabouts
from urbanjax.evaluation.batch import Job, moment, outcomes
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.missions import localized as them
from urbanjax.evaluation.missions.localized import LOCALIZATIONS, LocalizedMission, Roads
from urbanjax.evaluation.verdict import Cause
from urbanjax.evaluation.whereabouts import Whereabouts
from urbanjax.localization.mapping import PointMap
from urbanjax.localization.types import Health
from urbanjax.registration import MapParams
from urbanjax.registration.voxelmap import padded, voxelise
from urbanjax.rollout import LoopParams
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.lidar import LidarParams
from urbanjax.types import CloudError, ConfigError
from urbanjax.vehicle.params import VehicleParams

SENSOR = LidarParams(pattern="vlp_16", columns=512)
NAMES = ("cut_in", "signal_left", "tight_right")  # straight roads and curved ones


@pytest.fixture
def quick(monkeypatch):
    """Maps of points along the route, which take no scans."""

    def mapped(case, sensor, *, mission, which):
        along = np.asarray(case.corridor.position)[np.asarray(case.corridor.valid)]
        points = np.concatenate([np.c_[along + aside, np.ones(len(along))] for aside in ((0.0, 6.0), (6.0, 0.0))])
        found = voxelise(points, np.ones((len(points), 6)), count=np.ones(len(points)), params=MapParams())
        surroundings = them._room(them.furnish(case.lanes.graph, which), mission.size.n_prisms)
        return jax.device_get((surroundings, padded(found, them.VOXELS, tiles=them.TILES)))

    monkeypatch.setattr(them, "mapped", mapped)
    return Roads(SENSOR)


def case(roads, name, how, seed):
    mission = LocalizedMission(MISSIONS[name], how, roads)
    return mission.case(seed, others=TrafficParams(), vehicle=VehicleParams())


def changed(one, other):
    """Fields of the sensing, and the map, that differ."""
    names = [spec.name for spec in dataclasses.fields(one.sensing)]
    found = {
        name
        for name in names
        if not all(
            np.array_equal(a, b)
            for a, b in zip(
                jax.tree.leaves(getattr(one.sensing, name)), jax.tree.leaves(getattr(other.sensing, name)), strict=True
            )
        )
    }
    return found | ({"map"} if not np.array_equal(one.map.rows, other.map.rows) else set())


@pytest.mark.parametrize("name", NAMES)
def test_each_failure_changes_what_it_says_and_nothing_else(quick, name):
    plain = MISSIONS[name].case(5, others=TrafficParams(), vehicle=VehicleParams())
    well = case(quick, name, "scans", 5)
    for how, field in {"scan_loss": "silent", "map_gap": "map", "kidnapping": "told"}.items():
        found = case(quick, name, how, 5)
        assert changed(found, well) == {field}
        assert changed(found, case(quick, name, how, 5)) == set()
        for a, b in zip(
            jax.tree.leaves((found.start, found.goal, found.limit, found.corridor)),
            jax.tree.leaves((plain.start, plain.goal, plain.limit, plain.corridor)),
            strict=True,
        ):
            np.testing.assert_array_equal(a, b)
    np.testing.assert_allclose(well.sensing.told, [*well.start.ego.position, well.start.ego.heading])
    assert not np.any((well.sensing.silent[0] <= 0) & (well.sensing.silent[1] > 0))


@pytest.mark.parametrize("name", NAMES)
def test_failures_are_of_the_size_that_is_said(quick, name):
    ways = []
    for seed in range(8):
        well = case(quick, name, "scans", seed)
        begin, end = case(quick, name, "scan_loss", seed).sensing.silent
        assert 1.0 <= begin <= 6.0
        assert 1.0 <= end - begin <= 5.0 + 1e-5
        told, true = (case(quick, name, how, seed).sensing.told for how in ("kidnapping", "scans"))
        line = np.asarray(well.corridor.position)[np.asarray(well.corridor.valid)]
        rows = [int(np.argmin(np.linalg.norm(line - pose[:2], axis=1))) for pose in (true, told)]
        ways.append((rows[1] - rows[0]) * float(well.corridor.spacing))
        # As far beside the route as the ego is.
        beside = [np.linalg.norm(line - pose[:2], axis=1).min() for pose in (true, told)]
        np.testing.assert_allclose(*beside, atol=0.6)
        holed = case(quick, name, "map_gap", seed).map
        gone = (np.asarray(well.map.rows[:, 9]) > 0) & (np.asarray(holed.rows[:, 9]) == 0)
        place = (well.map.cell + well.map.first)[gone][:, :2]
        assert 20.0 < np.ptp(place, axis=0).max() < (60.0 if name == "cut_in" else 150.0)  # other legs of a junction
        ego = well.start.ego
        way = (place.mean(0) - ego.position) @ [np.cos(ego.heading), np.sin(ego.heading)]
        assert 10.0 < way < 85.0 or name != "cut_in"
    assert all(7.0 <= abs(way) <= 31.0 for way in ways)
    assert min(ways) < 0 < max(ways)


def test_missions_on_scans_share_their_shapes(quick):
    found = [case(quick, name, how, seed) for name in NAMES for how in LOCALIZATIONS for seed in (1, 2)]
    assert len({tuple((np.shape(x), np.asarray(x).dtype) for x in jax.tree.leaves(one)) for one in found}) == 1
    assert len({jax.tree.structure(one) for one in found}) == 1


def test_scenery_gets_the_room_that_it_is_given():
    found = them.furnish(MISSIONS["cut_in"].case(0, others=TrafficParams(), vehicle=VehicleParams()).lanes.graph, 0)
    roomy = them._room(found, 1000)
    assert roomy.valid.shape == (1000,)
    assert roomy.valid.sum() == np.asarray(found.valid).sum()
    np.testing.assert_array_equal(roomy.centre[: len(found.valid)], found.centre)
    with pytest.raises(CloudError, match="there is room for 10"):
        them._room(found, 10)


def test_a_road_that_does_not_fit_is_named(monkeypatch):
    monkeypatch.setattr(them, "TILES", 1)
    monkeypatch.setattr(them, "survey", lambda *_, **__: iter(()))
    monkeypatch.setattr(
        them.mapping, "build", lambda *_: PointMap(*(np.ones((9, n), np.float32) for n in (3, 6)), np.ones(9))
    )
    monkeypatch.setattr(them, "VOXELS", 0)
    with pytest.raises(ConfigError, match=r"road 3 of cut_in cannot be mapped: .*'sensor'"):
        case(Roads(SENSOR), "cut_in", "scans", 3)


def test_noise_is_of_one_drive_alone(quick):
    keys = [tuple(case(quick, name, "scans", seed).sensing.key) for name in NAMES for seed in range(3)]
    keys += [tuple(jax.random.key_data(them._key(them.SURVEYED, MISSIONS[name].number, 1))) for name in NAMES]
    assert len({tuple(int(x) for x in key) for key in keys}) == len(keys)


def test_only_the_stack_is_asked(quick):
    job = Job(LocalizedMission(MISSIONS["cut_in"], "scans", quick), 0)
    with pytest.raises(ConfigError, match="only the stack finds its pose"):
        next(outcomes(LoopParams(driver=IdmDriver()), [job]))


def test_the_row_says_how_well_it_knew_where_it_was():
    error = np.array([0.1, 0.2, 4.0, 0.7, 0.1, 9.0])
    health = np.array([Health.NORMAL, Health.PREDICT, Health.RELOCALIZE, Health.NORMAL, Health.STOP, Health.NORMAL])
    dropped = np.array([0, 3, 0, 0, 1, 7])
    parts = [Whereabouts(error[some], health[some], dropped[some]) for some in (slice(4), slice(4, None))]
    found = whereabouts.columns(parts, duration=0.4, period=0.1)
    assert whereabouts.columns([], duration=0.5, period=0.1) == {}
    assert found == pytest.approx(
        {
            "localization_mean_error_m": 5.1 / 5,
            "localization_largest_error_m": 4.0,
            "localization_not_normal_s": 0.3,
            "localization_longest_unnoticed_s": 0.1,
            "localization_stopped_s": 0.1,
            "localization_most_dropped": 3,
        }
    )


@pytest.mark.slow
def test_a_kidnapped_stack_finds_its_way_and_a_row_is_driven_again_alike():
    roads, loop = Roads(SENSOR), LoopParams(sensor=SENSOR)
    jobs = [
        Job(LocalizedMission(MISSIONS["signal_right"], how, roads), seed)
        for how in ("kidnapping", "scan_loss")
        for seed in (1, 2)
    ]
    found = list(outcomes(loop, jobs, logs=True))
    for one in found:
        lost = one.job.mission.how == "kidnapping"  # who is wrong at a stop line may run it
        assert one.row["cause"] == Cause.NONE or lost
        assert one.row["localization_longest_unnoticed_s"] < (2.0 if lost else 0.1)
        assert one.row["localization_not_normal_s"] > 0.5
        assert one.row["localization_stopped_s"] == 0.0
    assert found[0].row["localization_largest_error_m"] > 7.0
    (again,) = outcomes(loop, [jobs[1]], logs=True)
    for name, value in again.row.items():
        np.testing.assert_array_equal(value, found[1].row[name], err_msg=name)
    info = moment(loop, jobs[1], traffic="idm", time=6.3)
    believed = np.asarray(info.localization.pose.translation())
    np.testing.assert_allclose(believed, again.log.ego.position[63], atol=0.1)
    assert int(info.localization.health) == Health.NORMAL
