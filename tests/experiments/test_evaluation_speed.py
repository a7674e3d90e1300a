"""The benchmark of evaluations: its drives are those that it says, and its table holds what was measured."""

import dataclasses

import jax
import numpy as np
import pytest

from experiments.benchmark import evaluation_speed
from experiments.benchmark.evaluation_speed import DistrictMission, EvaluationSpeedStudy
from experiments.benchmark.study import BenchStudy
from urbanjax.course import course_between
from urbanjax.sim.lanes import from_graph
from urbanjax.sim.scenarios import circulate
from urbanjax.types import ConfigError, as_arrays
from urbanjax.types.unread import check_read

NUMBERS = {
    "evaluation_drives": 64.0,
    "evaluation_first_block_s": 40.0,
    "evaluation_streams": 2.0,
    "evaluation_drives_per_s": 5.0,
    "evaluation_decisions_per_s": 500.0,
    "evaluation_decisions_per_cpu_s": 400.0,
    "evaluation_peak_memory_mb": 1300.0,
    "evaluation_compiles": 40.0,
    "evaluation_compiles_of_the_loop": 1.0,
    "evaluation_compiles_when_warm": 0.0,
    "highway_env_decisions_per_s": 50.0,
    "highway_env_decisions_per_cpu_s": 55.0,
    "evaluation_times_highway_env": 10.0,
}


def test_table_names_the_peer_with_its_version_and_dashes_what_was_not_measured():
    rows = dict(zip(*evaluation_speed.table(NUMBERS).values(), strict=True))
    assert rows["growth over 50 chunks [MB]"] is None
    assert rows["times as many"] == 10.0
    assert any(name.startswith("highway-env 1.") for name in rows)


def test_growth_is_a_trend_and_no_difference_of_two_values_that_jump():
    rng = np.random.default_rng(0)
    flat = 1500.0 + rng.normal(0.0, 20.0, 300)
    still = evaluation_speed.growth(flat.tolist(), chunks=2)
    assert still["evaluation_memory_growth_mb_low"] < 0.0 < still["evaluation_memory_growth_mb_high"]
    leaking = evaluation_speed.growth((flat + 0.8 * np.arange(300)).tolist(), chunks=2)  # 0.4 MB a chunk
    assert leaking["evaluation_memory_growth_mb"] == pytest.approx(20.0, abs=2.0)
    assert leaking["evaluation_memory_growth_mb_low"] > 15.0


def test_drives_of_the_district_are_ten_seconds_among_32():
    bench = BenchStudy()
    graph = circulate.road(bench.scenario)
    course, lanes = course_between(graph, 1, goal=int(graph.predecessor[1, 0])), from_graph(graph)
    mission = DistrictMission(jax.device_get(course), jax.device_get(lanes), bench.scenario)
    loop = as_arrays(bench.loop())
    one, again, other = (mission.case(seed, others=loop.sim.traffic, vehicle=loop.vehicle) for seed in (3, 3, 4))
    assert one.start.traffic.valid.sum() == 32
    assert 9.9 < one.limit < 10.0
    assert one.goal > 10.0 * loop.vehicle.max_speed
    np.testing.assert_array_equal(one.start.traffic.station, again.start.traffic.station)
    assert np.any(one.start.traffic.station != other.start.traffic.station)


def test_few_drives_have_no_warm_chunk_and_what_is_not_measured_is_not_read():
    with pytest.raises(ConfigError, match="drives"):
        EvaluationSpeedStudy(drives=10)
    alone = dataclasses.replace(BenchStudy(), only="evaluation")
    check_read(alone, ["evaluation.drives"])
    with pytest.raises(ConfigError, match="see 'only'"):
        check_read(alone, ["goals"])


@pytest.mark.slow
def test_the_peer_is_timed():
    wall, cpu = evaluation_speed._peer(0, 4)
    assert 0 < cpu < 10 * wall < 10
