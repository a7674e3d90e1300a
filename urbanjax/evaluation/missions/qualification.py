"""The eight missions of the competition's qualification. Each is won by reaching the goal in time without a violation.

Violations are at-fault collisions, leaving the road, red signals, speeding and driving in an oncoming lane that may not
be used to overtake; see `scores.competition`.
"""

from functools import partial

from urbanjax.evaluation.missions.mission import Mission
from urbanjax.sim.scenarios import casts, drawn_roads


def overtake() -> Mission:
    """Pass a slow vehicle on a road with two to four lanes in one direction, straight or in a bend.

    Success: 150 m at 0.6 of the speed limit, plus 4 s. Failure: a violation, or still behind it when the time is up.
    """
    return Mission("overtake", 1, drawn_roads.multilane, casts.slow_leader, way=150.0, pace=0.6)


def cut_in() -> Mission:
    """Let a vehicle in that moves over 6 to 20 m ahead.

    Success: 110 m at 0.45 of the speed limit, plus 4 s. Failure: a violation, foremost running into it.
    """
    return Mission("cut_in", 2, drawn_roads.multilane, casts.cut_in, way=110.0, pace=0.45)


def narrow_passage() -> Mission:
    """Drive between vehicles that stand on both sides and leave 0.35 to 0.75 m on either side of the ego.

    Success: 120 m at 0.4 of the speed limit, plus 4 s, at most 30 s. Failure: touching one, or standing before them.
    """
    return Mission("narrow_passage", 3, drawn_roads.dual, casts.narrow, way=120.0, pace=0.4)


def accident_vehicle() -> Mission:
    """Get past vehicles that stand in the ego's lane while others pass beside.

    Success: 150 m at 0.5 of the speed limit, plus 4 s, at most 30 s. Failure: a violation, or standing behind them.
    """
    return Mission("accident_vehicle", 4, drawn_roads.multilane, casts.accident, way=150.0, pace=0.5)


def unsignalised() -> Mission:
    """Cross a road that has priority, without signals.

    Success: 115 m within 30 s. Failure: a violation, foremost a collision, or waiting for ever.
    """
    road = partial(drawn_roads.crossing, turn="straight", signals=False)
    return Mission("unsignalised", 5, road, casts.cross_traffic, way=115.0, pace=0.2)


def signal_straight() -> Mission:
    """Go straight on at signals whose red lasts 10 to 13 s.

    Success: 115 m within 30 s. Failure: running a red signal, any other violation, or not being through in time.
    """
    return _at_signals("straight", 6, way=115.0)


def signal_left() -> Mission:
    """Turn left at signals, before those who come the other way.

    Success: 115 m within 30 s. Failure: running a red signal, any other violation, or not being through in time.
    """
    return _at_signals("left", 7, way=115.0)


def signal_right() -> Mission:
    """Turn right at signals.

    Success: 105 m within 30 s. Failure: running a red signal, any other violation, or not being through in time.
    """
    return _at_signals("right", 8, way=105.0)


def _at_signals(turn: str, number: int, *, way: float) -> Mission:
    road = partial(drawn_roads.crossing, turn=turn, signals=True)
    return Mission(f"signal_{turn}", number, road, casts.signalised, way=way, pace=0.2)


QUALIFICATION = (
    overtake(),
    cut_in(),
    narrow_passage(),
    accident_vehicle(),
    unsignalised(),
    signal_straight(),
    signal_left(),
    signal_right(),
)
