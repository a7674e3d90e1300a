"""Every map of the data folder loads, with the counts that independent readers find.

The numbers were compared lane by lane with commonroad-io 2026.1, lanelet2 1.2.3 (vehicles, German rules) and sumolib.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.io import maps
from urbanjax.io.maps import validity
from urbanjax.roadmap.graph import Rule, Turn
from urbanjax.roadmap.locate import locate
from urbanjax.roadmap.route import route_between
from urbanjax.sim.signals import phases, show
from urbanjax.types import SignalState

pytestmark = [pytest.mark.real_data, pytest.mark.filterwarnings("ignore::urbanjax.io.maps.DanglingWarning")]

# Lanelets; stated successors, neighbours on the left and on the right, references to traffic lights; obstacles, their
# states, planning problems; length of the centre lines in m.
COMMONROAD = {
    "commonroad/CHN_Merging-1": (49, 38, 30, 30, 0, 0, 0, 0, 988.9),
    "commonroad/CHN_Roundabout-1": (94, 104, 46, 46, 0, 0, 0, 0, 1278.7),
    "commonroad/DEU_AachenBendplatz-1": (26, 30, 0, 0, 0, 0, 0, 0, 663.7),
    "commonroad/DEU_Guetersloh-11_2_T-1": (57, 64, 0, 0, 0, 9, 306, 1, 2343.7),
    "commonroad/DEU_MONAWest-2": (34, 26, 19, 19, 0, 0, 0, 0, 1753.3),
    "commonroad/DEU_Reutlingen-1_1_T-1": (58, 66, 0, 0, 0, 53, 5164, 1, 1650.0),
    "commonroad/DEU_Starnberg-1_1_T-1": (91, 105, 11, 11, 8, 0, 0, 0, 3457.7),
    "commonroad/ESP_Toledo-7_5_T-1": (42, 48, 0, 0, 0, 10, 343, 1, 1771.5),
    "commonroad/USA_Roundabout-1": (46, 40, 2, 2, 0, 0, 0, 0, 565.5),
    "commonroad_recorded/C-DEU_MONAMerge-2_1_T-299": (7, 4, 3, 3, 0, 51, 1464, 4, 853.3),
    "commonroad_recorded/OSC_CutIn-1_2_T-1": (2, 0, 0, 0, 0, 2, 200, 1, 1000.0),
    "commonroad_recorded/USA_Lanker-1_1_T-1": (91, 84, 57, 57, 0, 24, 938, 1, 1689.4),
    "commonroad_recorded/USA_Peach-4_8_T-1": (79, 76, 43, 43, 13, 9, 368, 1, 1638.4),
    "commonroad_recorded/USA_US101-3_3_T-1": (12, 6, 9, 9, 0, 12, 384, 1, 1181.3),
    "commonroad_recorded/USA_US101-4_1_T-1": (12, 6, 9, 9, 0, 22, 1271, 1, 732.1),
    "commonroad_recorded/USA_US101-5_1_T-1": (5, 0, 4, 4, 0, 25, 1619, 1, 648.3),
    "commonroad_recorded/ZAM_Zip-1_56_T-1": (5, 4, 1, 1, 0, 3, 258, 1, 508.1),
    "frenet_examples/ZAM_Over-1_1": (2, 0, 0, 0, 0, 1, 1, 1, 400.0),
    "frenet_examples/ZAM_Tjunction-1_42_T-1": (12, 12, 0, 0, 0, 5, 740, 1, 929.2),
}
# Links that the geometry turns round, and those that it leaves out.
REPAIRED = {"CHN_Merging-1": (6, 1), "CHN_Roundabout-1": (37, 20), "USA_Roundabout-1": (12, 4)}
R, Y, G = (int(state) for state in (SignalState.RED, SignalState.YELLOW, SignalState.GREEN))
locate_jit = jax.jit(locate)
RECORDED = ("USA_US101-3_3_T-1", "USA_US101-4_1_T-1", "USA_US101-5_1_T-1", "USA_Lanker-1_1_T-1", "USA_Peach-4_8_T-1")


def test_no_file_is_forgotten(data_dir):
    folders = ("commonroad", "commonroad_recorded", "frenet_examples")
    files = {f"{folder}/{path.stem}" for folder in folders for path in (data_dir / "maps" / folder).glob("*.xml")}
    assert files == set(COMMONROAD)


@pytest.mark.parametrize("name", COMMONROAD)
def test_commonroad(data_dir, name):
    found = maps.read(data_dir / "maps" / f"{name}.xml")
    lanes, graph, recording = found.lanes, found.graph, found.recording
    assert (
        len(lanes),
        sum(len(lane.successors) for lane in lanes),
        sum(lane.left_id is not None for lane in lanes),
        sum(lane.right_id is not None for lane in lanes),
        sum(len(lane.signals) for lane in lanes),
        0 if recording is None else len(recording.ids),
        0 if recording is None else int(np.where(recording.standing, 1, recording.valid.sum(0)).sum()),
        len(found.problems),
    ) == COMMONROAD[name][:-1]
    assert len(found.ids) == len(lanes)
    # Border points out of order, which two of the maps have, make a centre line of their own longer.
    exact = "CHN" not in name and "USA_R" not in name
    assert float(graph.length.sum()) == pytest.approx(COMMONROAD[name][-1], rel=1e-3 if exact else 0.025)
    assert int(graph.has_left.sum()) == COMMONROAD[name][2]
    kinds = [fault.kind for fault in found.faults]
    turned, left_out = REPAIRED.get(name.split("/")[-1], (0, 0))
    assert (kinds.count("turned link"), kinds.count("gap")) == (turned, left_out)
    if exact:
        assert int(graph.has_successor.sum()) == COMMONROAD[name][1]
        overlaps = {"self-overlap", "swapped borders", "twice", "one-sided link"}
        assert not overlaps & {fault.kind for fault in validity.report(found).faults}


@pytest.mark.parametrize("name", RECORDED)
def test_recorded_traffic_drives_on_the_lanes(data_dir, name):
    found = maps.read(data_dir / "maps" / "commonroad_recorded" / f"{name}.xml")
    recording = found.recording
    at = np.linspace(0, recording.n_times - 1, 5).astype(int)
    valid = recording.valid[at]
    position, heading = recording.position[at][valid], recording.heading[at][valid]
    place = locate_jit(found.graph, jnp.asarray(position, jnp.float32), heading=jnp.asarray(heading, jnp.float32))
    assert bool(np.all(np.asarray(place.valid)))
    assert np.percentile(np.abs(place.offset), 90) < 1.6
    assert np.percentile(np.abs(place.heading_error), 90) < 0.25
    moved = np.linalg.norm(np.diff(recording.position, axis=0), axis=-1) / recording.dt
    both = recording.valid[1:] & recording.valid[:-1]
    assert np.median(np.abs(moved - recording.speed[1:])[both]) < 0.15


def test_the_signals_of_peachtree_turn_red_while_it_was_recorded(data_dir):
    found = maps.read(data_dir / "maps" / "commonroad_recorded" / "USA_Peach-4_8_T-1.xml")
    program = phases(found.cycles, found.graph.n_signals)
    for time, states in ((0.0, (Y, Y, R, R)), (1.9, (Y, Y, R, R)), (2.0, (R, R, R, R)), (9.0, (R, R, G, G))):
        assert show(program, jnp.asarray(time)).state.tolist() == list(states)


def test_a_planning_problem_of_lankershim_can_be_routed(data_dir):
    found = maps.read(data_dir / "maps" / "commonroad_recorded" / "USA_Lanker-1_1_T-1.xml")
    (problem,) = found.problems
    goal = problem.goals[0].regions[0]
    ends = np.array([problem.position, goal.centre], np.float32)
    heading = jnp.asarray([problem.heading, goal.heading], jnp.float32)
    place = locate_jit(found.graph, jnp.asarray(ends), heading=heading)
    start, end = (int(link) for link in place.link)
    route = route_between(found.graph, start, goal=end)
    assert [found.ids[int(link)] for link in route.link[route.valid]] == [3630, 3650, 3614]


@pytest.mark.parametrize(
    ("name", "links", "successors", "beside", "permitted", "signals", "rules"),
    [
        ("kashiwanoha_lanelet2_map", 77, 93, (3, 3), (3, 3), 1, (2, 1)),
        ("tier4_test_intersection_lanelet2_map", 58, 57, (19, 19), (10, 10), 4, (0, 0)),
    ],
)
def test_lanelet2(data_dir, name, links, successors, beside, permitted, signals, rules):
    found = maps.read(data_dir / "maps" / "lanelet2" / f"{name}.osm")
    graph = found.graph
    assert len(found.ids) == links
    assert found.other["crosswalk lanelets"] == 4
    assert int(graph.has_successor.sum()) == successors
    assert (int(graph.has_left.sum()), int(graph.has_right.sum())) == beside
    assert (int(graph.left_change.sum()), int(graph.right_change.sum())) == permitted
    assert graph.n_signals == signals
    assert tuple(int(np.sum(np.asarray(graph.rule) == rule)) for rule in (Rule.YIELD, Rule.STOP)) == rules
    assert (found.geo is None) == (name[0] == "t")
    length = {"k": 1654.4, "t": 2172.5}[name[0]]
    assert float(graph.length.sum()) == pytest.approx(length, rel=1e-3)


def test_seoul(data_dir):
    found = maps.read(data_dir / "maps" / "sumo" / "cauH_seoul.net.xml")
    graph, other = found.graph, found.other
    assert (other["edges"], other["lanes"], other["lanes in junctions"]) == (2265, 2464, 2464 - 609)
    assert (other["lanes without cars"], other["tlLogic"]) == (364, 40)
    assert len(found.lanes) == 2100
    assert sum(len(set(lane.successors)) for lane in found.lanes) == 2810
    assert [fault.kind for fault in found.faults] == ["zero length"] * 6
    assert len(found.ids) == 2094
    assert float(graph.length.sum()) == pytest.approx(76_950, rel=2e-3)
    assert int((graph.turn == Turn.U_TURN).sum()) == 542
    assert (len({light for light, _ in found.signal_ids}), len(found.signal_ids)) == (40, 96)
    assert all(sum(cycle.duration) > 0 for cycle in found.cycles)


def test_a_plain_extract_of_openstreetmap_is_no_lanelet2_map(data_dir):
    with pytest.raises(maps.MapError, match="holds no lanelet"):
        maps.read(data_dir / "maps" / "osm" / "cauH_seoul.osm")


def test_a_map_saved_by_an_editor_keeps_its_negative_ids(data_dir):
    found = maps.read(data_dir / "traffic" / "signals" / "Tianjin_map.osm")
    assert (len(found.ids), max(found.ids) < 0, found.faults) == (34, True, ())
