"""Who drives where at the start of each kind of situation, drawn from ranges (host side)."""

from typing import Any

import numpy as np

from urbanjax.roadmap.graph import RoadType
from urbanjax.sim.scenarios.stage import Cast
from urbanjax.sim.signals import SignalProgram
from urbanjax.types import RoadUser, as_arrays

START = 40.0  # m, station of the ego's rear axle
EGO_PACE = (0.6, 0.95)  # of the speed limit
OTHERS_PACE = (0.5, 0.9)
SLOW = (1.5, 4.0)  # m/s, of a leader that is to be passed
ROOM = 4.0  # m, free around every vehicle at the start
LINE = 3.0  # m from the end of a leg, before which one can stop
COMFORT = 2.0  # m/s^2, of that
SPACING = 16.0  # m, between places in one lane of a dense street
AROUND = 160.0  # m, of the ego's start, within which it is filled
EGO_ROOM = 14.0  # m, that stay free around it
WISH = (0.6, 1.1)  # of the speed limit, what drivers there want
HEADWAY = (0.9, 1.8)  # s
START_SHARE = 0.6  # of the wanted speed, at which they start
LEAVES = 0.7  # share of those in a roundabout who leave it at the next leg
PERIOD = 0.1  # s, of what is written


def limit_of(cast: Cast) -> float:
    """The speed limit [m/s] where the ego starts. Args: cast, on its stage."""
    return float(cast.stage.corridor.speed_limit[round(START)])


def enter(rng: np.random.Generator, cast: Cast) -> float:
    """The ego, at a drawn speed [m/s], which is returned. Args: rng; cast."""
    speed = float(rng.uniform(*EGO_PACE)) * limit_of(cast)
    cast.add_ego(START, speed=speed)
    return speed


def fill(rng: np.random.Generator, cast: Cast, *, count: int, lanes: list[int], reach: tuple[float, float]) -> None:
    """Up to `count` vehicles at random places that are free.

    Args: rng; cast; count; lanes, to the left of the route's; reach, stations m.
    """
    for _ in range(4 * count):
        if count == 0 or not lanes:
            return
        station, lane = float(rng.uniform(*reach)), int(rng.choice(lanes))
        there = lane in cast.stage.lanes_at(station)
        if there and cast.free(station, lane, gap=2 * cast.half + ROOM):
            cast.add(station, speed=float(rng.uniform(*OTHERS_PACE)) * limit_of(cast), lane=lane)
            count -= 1


def beside(cast: Cast) -> list[int]:
    """The other lanes in the ego's direction. Args: cast."""
    return [lane for lane in cast.stage.lanes_at(START) if lane != 0]


def slow_leader(rng: np.random.Generator, cast: Cast) -> None:
    """A slow vehicle 15 to 40 m ahead, others in the lanes beside. Args: rng; cast."""
    enter(rng, cast)
    gap = float(rng.uniform(15.0, 40.0))
    cast.add(cast.front + gap + cast.half, speed=float(rng.uniform(*SLOW)), reacts=False)
    fill(rng, cast, count=int(rng.integers(0, 4)), lanes=beside(cast), reach=(5.0, START + 80.0))


def cut_in(rng: np.random.Generator, cast: Cast) -> None:
    """A slower vehicle 6 to 20 m ahead that begins to move over into the ego's lane. Args: rng; cast."""
    speed = enter(rng, cast)
    station = cast.front + float(rng.uniform(6.0, 20.0)) + cast.half
    near = [lane for lane in beside(cast) if abs(lane) == 1]
    lane = int(rng.choice(near))
    link, along = cast.stage.place(station, lane)
    offset = cast.stage.offset(station, lane) - cast.stage.offset(station, 0)
    cast.add(
        station,
        speed=max(speed - float(rng.uniform(0.0, 4.0)), 2.0),
        desired_speed=float(rng.uniform(0.45, 0.75)),
        offset=offset,
        offset_from=offset,
        moved=0.0,
        other=link,
        other_station=along,
        has_other=True,
    )
    fill(rng, cast, count=int(rng.integers(0, 3)), lanes=[x for x in beside(cast) if x != lane], reach=(5.0, 120.0))


def accident(rng: np.random.Generator, cast: Cast) -> None:
    """One or two vehicles that stand in the ego's lane 45 to 80 m ahead, others pass beside. Args: rng; cast."""
    enter(rng, cast)
    station = cast.front + float(rng.uniform(45.0, 80.0)) + cast.half
    for _ in range(int(rng.integers(1, 3))):
        cast.add_standing(station, offset=float(rng.uniform(-0.5, 0.5)))
        station += 2 * cast.half + float(rng.uniform(0.5, 3.0))
    fill(rng, cast, count=int(rng.integers(0, 4)), lanes=beside(cast), reach=(5.0, START + 60.0))


def narrow(rng: np.random.Generator, cast: Cast) -> None:
    """Vehicles that stand on both sides and leave the ego's width and 0.7 to 1.5 m. Args: rng; cast."""
    enter(rng, cast)
    station = cast.front + float(rng.uniform(35.0, 70.0)) + cast.half
    left = cast.stage.offset(station, 1)
    middle, room = left / 2 + float(rng.uniform(-0.3, 0.3)), float(cast.vehicle.width) + float(rng.uniform(0.7, 1.5))
    reach = (room + float(cast.others.vehicle_width)) / 2
    for _ in range(int(rng.integers(1, 3))):
        cast.add_standing(station, lane=0, offset=middle - reach)
        cast.add_standing(station + float(rng.uniform(-2.0, 2.0)), lane=1, offset=middle + reach - left)
        station += 2 * cast.half + float(rng.uniform(1.0, 3.0))


def oncoming_overtake(rng: np.random.Generator, cast: Cast) -> None:
    """A slow vehicle ahead and one to three oncoming ones. Args: rng; cast, on an undivided road."""
    enter(rng, cast)
    cast.add(cast.front + float(rng.uniform(15.0, 40.0)) + cast.half, speed=float(rng.uniform(*SLOW)), reacts=False)
    oncoming(rng, cast, count=int(rng.integers(1, 4)))


def double_parked(rng: np.random.Generator, cast: Cast) -> None:
    """One or two vehicles that stand in most of the ego's lane, oncoming ones beside. Args: rng; cast."""
    enter(rng, cast)
    station = cast.front + float(rng.uniform(35.0, 70.0)) + cast.half
    for _ in range(int(rng.integers(1, 3))):
        cast.add_standing(station, offset=float(rng.uniform(-1.2, -0.2)))
        station += 2 * cast.half + float(rng.uniform(1.0, 25.0))
    oncoming(rng, cast, count=int(rng.integers(0, 3)))


def oncoming(rng: np.random.Generator, cast: Cast, *, count: int) -> None:
    """Vehicles on the lane left of the ego's that come towards it. Args: rng; cast; count."""
    for station in np.sort(rng.uniform(START + 50.0, START + 280.0, count)):
        if cast.free(float(station), 1, gap=2 * cast.half + ROOM):
            cast.add(float(station), speed=float(rng.uniform(*OTHERS_PACE)) * limit_of(cast), lane=1)


def congestion(rng: np.random.Generator, cast: Cast) -> None:
    """Dense lanes in which everybody starts and crawls, at a wish of 2 to 5 m/s. Args: rng; cast."""
    cast.add_ego(START, speed=float(rng.uniform(1.0, 4.0)))
    for lane in sorted(cast.stage.lanes_at(START), key=abs)[:3]:
        station = cast.front + float(rng.uniform(4.0, 8.0)) if lane == 0 else START + float(rng.uniform(-12.0, 4.0))
        for _ in range(4):
            wish = float(rng.uniform(2.0, 5.0)) / limit_of(cast)
            cast.add(station + cast.half, speed=float(rng.uniform(0.0, 2.0)), lane=lane, desired_speed=wish)
            station += 2 * cast.half + float(rng.uniform(2.0, 6.0))


def merging(rng: np.random.Generator, cast: Cast) -> None:
    """Traffic in the lane into which the ego has to merge. Args: rng; cast, on a road whose right lane ends."""
    enter(rng, cast)
    graph, beside_it = cast.stage.graph, int(cast.stage.graph.left_link[cast.ego_link])
    for station in spread(rng, cast, reach=(5.0, float(graph.length[beside_it])), count=int(rng.integers(3, 8))):
        cast.add_on(beside_it, station, speed=float(rng.uniform(*OTHERS_PACE)) * limit_of(cast))


def stepping_out(rng: np.random.Generator, cast: Cast) -> None:
    """A pedestrian who steps out at most 3.5 s before the ego would be there, and walks across. Args: rng; cast."""
    speed = enter(rng, cast)
    away, walk = float(rng.uniform(25.0, 50.0)), float(rng.uniform(1.2, 2.0))
    station = cast.front + away
    begin = max(away / speed - float(rng.uniform(1.5, 3.5)), 0.0)
    time = PERIOD * np.arange(cast.stage.size.n_times)
    lanes = cast.stage.lanes_at(station)
    width = float(cast.stage.corridor.lane_width[round(station), cast.stage.corridor.route_lane])
    right, left = cast.stage.offset(station, lanes[0]) - width, cast.stage.offset(station, lanes[-1]) + width
    across = np.minimum(right + walk * np.maximum(time - begin, 0), left)
    way = np.stack([cast.stage.point(station, float(offset))[0] for offset in across])
    cast.add_written(way, period=PERIOD, kind=RoadUser.PEDESTRIAN)
    fill(rng, cast, count=int(rng.integers(0, 3)), lanes=beside(cast), reach=(5.0, START))


def spread(rng: np.random.Generator, cast: Cast, *, reach: tuple[float, float], count: int) -> list[float]:
    """Up to `count` stations [m] that are far enough apart. Args: rng; cast; reach [m]; count."""
    found: list[float] = []
    for station in np.sort(rng.uniform(*reach, count)):
        if not found or station - found[-1] > 2 * cast.half + ROOM:
            found.append(float(station))
    return found


def ring_traffic(rng: np.random.Generator, cast: Cast) -> None:
    """Vehicles on the other legs of a roundabout: most leave at the next leg, the others go round. Args: rng; cast."""
    cross_traffic(rng, cast)
    for row in cast.rows:
        row["route"] = int(rng.random() < LEAVES)


def cross_traffic(rng: np.random.Generator, cast: Cast) -> None:
    """Vehicles on the other legs of an intersection, slow enough to stop there, which turn as they like.

    Args: rng; cast.
    """
    enter(rng, cast)
    graph = cast.stage.graph
    comes_in = np.flatnonzero(np.asarray(graph.valid) & ~np.asarray(graph.has_predecessor).any(1))
    own = {cast.ego_link}
    for side, there in ((graph.left_link, graph.has_left), (graph.right_link, graph.has_right)):
        own |= {int(side[cast.ego_link])} if bool(there[cast.ego_link]) else set()
    for link in rng.permutation([int(x) for x in comes_in if int(x) not in own]):
        length = float(graph.length[link])
        for station in spread(rng, cast, reach=(5.0, length - 10.0), count=int(rng.integers(0, 3))):
            if len(cast.rows) < cast.stage.size.n_vehicles:
                room = max(length - LINE - cast.half - station, 0.0)
                speed = min(float(rng.uniform(*OTHERS_PACE)) * limit_of(cast), float(np.sqrt(2 * COMFORT * room)))
                cast.add_on(int(link), station, speed=speed, route=int(rng.integers(0, 12)))


def signalised(rng: np.random.Generator, cast: Cast) -> None:
    """The same with signals: two phases in a cycle of 18 to 24 s that begins anywhere. Args: rng; cast."""
    cross_traffic(rng, cast)
    cast.signals = alternate(rng, cast.stage.size.n_signals)


def dense(rng: np.random.Generator, cast: Cast) -> None:
    """A street full of vehicles that want more or less than the limit and change lanes, at signals that change.

    Args: rng; cast, on a stage of many links.
    """
    enter(rng, cast)
    graph, stage = cast.stage.graph, cast.stage
    junction, here = np.asarray(graph.road_type) == RoadType.JUNCTION, stage.point(START)[0]
    places = [
        (int(link), station)
        for link in np.flatnonzero(np.asarray(graph.valid) & ~junction & ~np.asarray(stage.lanes.ends))
        for station in np.arange(float(rng.uniform(6.0, 14.0)), float(graph.length[link]) - 6.0, SPACING)
        if EGO_ROOM < np.linalg.norm(stage.on(int(link), station) - here) < AROUND
    ]
    for k in rng.permutation(len(places))[: stage.size.n_vehicles]:
        link, station = places[k]
        wish, limit = float(rng.uniform(*WISH)), float(graph.speed_limit[link])
        own = {"headway": float(rng.uniform(*HEADWAY)), "changes": True, "desired_speed": wish}
        cast.add_on(link, station, speed=START_SHARE * wish * limit, **own)
    cast.signals = alternate(rng, stage.size.n_signals)


def alternate(rng: np.random.Generator, count: int) -> SignalProgram:
    """Signals of two phases in a cycle of 18 to 24 s that begins anywhere. Args: rng; count, of signals."""
    cycle, yellow, clearance = float(rng.uniform(18.0, 24.0)), 3.0, 1.0
    begin = float(rng.uniform(0.0, cycle))
    phase = np.arange(count) % 2
    each, share = np.ones(count), 0.5 - (yellow + clearance) / cycle
    program: dict[str, Any] = {"offset": begin + phase * cycle / 2, "green": share * each}
    return SignalProgram(**as_arrays({**program, "cycle": cycle * each, "yellow": yellow * each}))


def alone(rng: np.random.Generator, cast: Cast) -> None:
    """Nobody else. Args: rng; cast."""
    enter(rng, cast)
