"""Missions in which published planners lose half their score. Each is won as those of the qualification are."""

import dataclasses
from functools import partial

from urbanjax.evaluation.missions.mission import LONGEST, Mission
from urbanjax.roadmap.padding import GraphSize
from urbanjax.sim.scenarios import casts, drawn_roads
from urbanjax.sim.scenarios.stage import StageSize

WALKED = dataclasses.replace(StageSize(), n_recorded=1, n_times=round(LONGEST / casts.PERIOD) + 2)

DISTRICT = dataclasses.replace(
    StageSize(),
    graph=GraphSize(n_links=196, n_successors=3, n_relations=9, n_signals_per_link=1),
    n_signals=10,
    n_vehicles=32,
    n_prisms=4096,
)


def congestion() -> Mission:
    """Get on in dense lanes that start and crawl.

    Success: 40 m within 30 s. Failure: a violation, foremost running into the one ahead.
    """
    return Mission("congestion", 11, drawn_roads.multilane, casts.congestion, way=40.0, pace=0.05)


def lane_drop() -> Mission:
    """Merge out of a lane that ends, between others.

    Success: 200 m at 0.5 of the speed limit, plus 4 s, at most 30 s. Failure: a violation, or standing at the end.
    """
    return Mission("lane_drop", 12, drawn_roads.lane_drop, casts.merging, way=200.0, pace=0.5)


def oncoming_overtake() -> Mission:
    """Pass a slow vehicle in the lane of those who come the other way.

    Success: 145 m at 0.55 of the speed limit, plus 4 s. Failure: a violation, or still behind it when the time is up.
    """
    return Mission("oncoming_overtake", 13, drawn_roads.undivided, casts.oncoming_overtake, way=145.0, pace=0.55)


def roundabout() -> Mission:
    """Enter a roundabout between those who drive in it, and leave it at the first, second or third leg.

    Success: 10 m behind the ring within 30 s. Failure: a violation, foremost a collision, or waiting for ever.
    """
    return Mission("roundabout", 17, drawn_roads.ring, casts.ring_traffic, way=None, pace=0.15)


def double_parked() -> Mission:
    """Get past vehicles that stand in most of the ego's lane, with others coming the other way.

    Success: 130 m within 30 s. Failure: a violation, or standing behind them.
    """
    return Mission("double_parked", 14, drawn_roads.undivided, casts.double_parked, way=130.0, pace=0.2)


def tight_right() -> Mission:
    """Turn right round a corner that the vehicle's body hardly fits.

    Success: 85 m at 0.35 of the speed limit, plus 4 s. Failure: leaving the road, or not getting round.
    """
    road = partial(drawn_roads.crossing, turn="right", signals=False, tight=True)
    return Mission("tight_right", 15, road, casts.alone, way=85.0, pace=0.35)


def pedestrian() -> Mission:
    """Let somebody live who steps out at most 3.5 s before the ego would be there.

    Success: 110 m within 30 s. Failure: a violation, foremost touching the pedestrian.
    """
    return Mission("pedestrian", 16, drawn_roads.dual, casts.stepping_out, way=110.0, pace=0.2, size=WALKED)


def district() -> Mission:
    """Get on in a street of several lanes, full of vehicles that change them, past signals, lane drops and curves.

    Success: 150 m within 30 s. Failure: a violation, or not being there in time.
    """
    return Mission("district", 18, drawn_roads.city, casts.dense, way=150.0, pace=0.2, size=DISTRICT)


HARD = (
    congestion(),
    lane_drop(),
    oncoming_overtake(),
    roundabout(),
    double_parked(),
    tight_right(),
    pedestrian(),
    district(),
)
