"""What a driver makes of signals: unknown is red, yellow is red where there is room, a queue at red is not "stuck"."""

import ast
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import urbanjax
from tests.planning.conftest import Scenes
from urbanjax.behavior import tree
from urbanjax.behavior.situation import body_of, near_signal, signal_ahead
from urbanjax.behavior.tree import TSPSParams
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.situation import Situation
from urbanjax.types import Objects, Signals, SignalState
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams

VEHICLE = VehicleParams()
UNKNOWN, RED, YELLOW, GREEN = SignalState.UNKNOWN, SignalState.RED, SignalState.YELLOW, SignalState.GREEN
NONE = Signals(jnp.zeros(0, jnp.int32), jnp.zeros(0), jnp.zeros(0, bool))


def one(state: int, valid: bool = True) -> Signals:
    return Signals(jnp.asarray([state], jnp.int32), jnp.ones(1), jnp.asarray([valid]))


@jax.jit
def _ahead(situation):
    return signal_ahead(situation, body_of(situation, VEHICLE), params=TSPSParams())


def ahead(signals: Signals, distance: float, speed: float = 10.0):
    """The signal `distance` metres before the front bumper."""
    road = Scenes.road()
    at, ego = Scenes.ego(road, speed=speed)
    front = at.station - VEHICLE.rear_overhang + VEHICLE.length
    road = road.replace(stop_station=(front + distance)[None], has_stop=jnp.ones(1, bool))
    zero = jnp.zeros(1)
    nobody = Objects(jnp.zeros((1, 2)), zero, zero, zero, zero, zero > 0)
    return _ahead(Situation(road, at, ego, nobody, Scenes.traffic(road, []), signals))


@pytest.mark.parametrize(
    "signals", [one(RED), one(UNKNOWN), one(RED, False), one(GREEN, False), one(YELLOW, False), NONE]
)
def test_what_is_not_known_to_be_green_is_red(signals):
    assert ahead(signals, 20.0).red == 1
    assert ahead(signals, 20.0).exists


def test_green_is_driven():
    assert ahead(one(GREEN), 20.0).red == 0


def test_a_signal_of_another_number_is_not_taken_for_this_one():
    two = Signals(jnp.asarray([GREEN, RED], jnp.int32), jnp.ones(2), jnp.asarray([True, True]))
    np.testing.assert_array_equal(two.shown(jnp.asarray([0, 1, 2, 9])), [GREEN, RED, RED, RED])


@pytest.mark.parametrize(
    ("distance", "speed", "stops"), [(5.0, 14.0, False), (60.0, 14.0, True), (5.0, 3.0, True), (0.5, 0.0, True)]
)
def test_at_yellow_one_stops_where_there_is_room(distance, speed, stops):
    assert ahead(one(YELLOW), distance, speed).red == stops


def test_who_brakes_for_yellow_keeps_braking():
    speed, distance, dt = 14.0, 35.0, 0.1
    while speed > 0.2:
        assert ahead(one(YELLOW), distance, speed).red == 1
        distance -= speed * dt
        speed -= 3.0 * dt
    assert distance > 0


@pytest.mark.parametrize(
    ("remaining", "distance", "stops"),
    [(1.0, 12.0, True), (2.0, 12.0, False), (1.0, 6.0, False), (np.nan, 12.0, False), (0.0, 12.0, False)],
)
def test_who_would_come_to_the_line_at_red_stops_as_hard_as_it_takes(remaining, distance, stops):
    """At 10 m/s: 12 m ask for 5.6 m/s^2 after the reaction, 4.2 at once; 6 m for more than there is."""
    yellow = one(YELLOW).replace(remaining=jnp.full(1, remaining))
    assert ahead(yellow, distance, 10.0).red == stops


def test_nobody_reads_what_a_signal_shows_but_by_its_method():
    """A new reader of `signals.state` or `signals.valid` would have to think of unknown ones again."""
    root, found = Path(urbanjax.__file__).parent, []
    for file in root.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Attribute) and node.attr in ("state", "valid", "remaining"):
                owner = ast.unparse(node.value)
                if owner.endswith(("signals", "signal", "shown", "program")):
                    found.append(f"{file.relative_to(root)}: {ast.unparse(node)}")
    assert not found, found


@pytest.mark.parametrize("distance", [10.0, 60.0, 120.0])
def test_a_queue_at_red_does_not_count_as_stuck_and_one_at_green_only_when_its_head_must_have_left(distance):
    driving = Driving(VEHICLE, TSPSParams(), Relaxation(), 0.1)
    red, zero = ahead(one(RED), distance, 0.0), jnp.zeros(())

    def stand(signal, seconds):
        state = tree.init(jnp.dtype(jnp.float32))
        queued = near_signal(signal, driving, reach=driving.params.queue_distance)
        for _ in range(round(seconds / 0.1)):
            state = tree.remember(state, driving, speed=zero, held=queued * signal.red, route_free=zero, micro=zero)
        return float(tree.standing(state, driving, queued=queued, distance=signal.distance))

    green = ahead(one(GREEN), distance, 0.0)
    wait = distance / driving.params.queue_start
    assert stand(red, 60.0) == 0
    assert stand(green, 2.9 + wait) == 0
    assert stand(green, 3.2 + wait) == 1
