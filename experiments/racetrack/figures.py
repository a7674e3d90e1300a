"""The figures of the racetrack study: a course's lattice and its cheapest lap, and a macro plan (Fig. 4 and 8)."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.racetrack.study import Lap
from urbanjax.course import course_between
from urbanjax.io.figures import lattices
from urbanjax.io.figures.lattices import draw_lattice
from urbanjax.io.figures.roads import draw_boxes, draw_road
from urbanjax.io.figures.style import GOOD, OTHER, figure
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import macro
from urbanjax.planning.lattice.course_path import driven
from urbanjax.planning.macro import MacroParams
from urbanjax.planning.previous import nothing
from urbanjax.planning.situation import Situation
from urbanjax.roadmap.builders import curve
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.corridor import Corridor, WindowParams, window
from urbanjax.roadmap.progress import Progress, to_world
from urbanjax.types import Prediction, VehicleState, as_arrays
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams


def draw_course(lap: Lap, path: Path) -> None:
    """The whole lattice with the marginals of its nodes and the cheapest lap; beside it, where the lap bends most."""
    lattice, there = lap.lattice, np.asarray(lap.lattice.node) > 0.5
    nodes = jnp.asarray(lap.hard[1].argmax(1))
    line = jax.tree.map(np.asarray, driven(lap.course.corridor, lattice, nodes=nodes, samples=12))
    position, edges = np.asarray(lattice.position), lap.hard[2] > 0.5
    with figure(path, 11.0, height=5.6) as canvas:
        whole, near = canvas.subplots(1, 2)
        for axes in (whole, near):
            draw_road(axes, lap.course.graph)
        draw_lattice(whole, position, weight=lap.soft[1], there=there, path=line.position, size=3.0)
        whole.set_title(f"Lattice of {there.sum()} nodes, cheapest lap")
        usable = np.asarray(lattice.edge)[: len(edges)] > 0.5
        dots = draw_lattice(
            near, position, weight=lap.soft[1], there=there, edges=usable, path=line.position, size=16.0
        )
        middle, reach = line.position[np.abs(line.curvature).argmax()], 28.0
        near.set(xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach))
        near.set_title("Its sharpest bend: nodes by marginal, edges, lap")
        canvas.colorbar(dots, ax=near, label="weight of the node", shrink=0.8)


def draw_macro(path: Path, temperature: float) -> None:
    """A macro plan past a slow leader in a bend of three lanes: weights of the nodes and the plan, hard and soft."""
    graph = curve(60.0, np.pi / 3, n_lanes=3, lead=60.0, style=RoadStyle(section=500.0))
    links = [k for k in range(graph.length.shape[0]) if bool(graph.has_left[k] & graph.has_right[k])]
    course = course_between(graph, links[0], goal=links[-1])
    ahead = as_arrays(window(course.corridor, jnp.asarray(30.0), params=WindowParams()))
    leader = _leader(ahead, station=62.0, speed=3.0)
    vehicle, params = as_arrays(VehicleParams()), as_arrays(MacroParams())
    position, heading, _ = to_world(ahead, jnp.asarray(30.0), offset=jnp.asarray(0.0))
    zero = jnp.zeros_like(heading)
    ego = VehicleState(position=position, heading=heading, speed=zero + 10, acceleration=zero, steering=zero)
    place = Progress(station=zero + 30, offset=zero, heading_error=zero)
    unseen: Any = None  # macro planning reads predictions, neither objects nor signals
    situation = Situation(ahead, place, ego, objects=unseen, prediction=leader, signals=unseen)
    with figure(path, 11.0, height=3.4) as canvas:
        both, dots = canvas.subplots(1, 2), None
        for axes, mode in zip(both, ("hard", "soft"), strict=True):
            relaxation = as_arrays(Relaxation(temperature, mode=mode))
            driving = Driving(vehicle, params, relaxation, 0.1)
            plan = _macro(situation, driving, as_arrays(nothing(params.n_layers)))
            draw_road(axes, graph)
            axes.set(xlim=(20, 140), ylim=(-15, 45))
            dots = lattices.draw_macro(axes, ahead, plan=plan)
            draw_boxes(axes, _box(position, heading, vehicle), colour=GOOD)
            shown = np.arange(0, leader.time.shape[0], 4)
            boxes = [
                np.r_[leader.position[0, k], leader.heading[0, k], leader.length[0], leader.width[0]] for k in shown
            ]
            draw_boxes(axes, np.array(boxes), colour=OTHER)
            axes.set(title=f"Macro plan, {mode}" + (f", temperature {temperature:g}" if mode == "soft" else ""))
        canvas.colorbar(dots, ax=both[1], label="weight of the node", shrink=0.8)


def _leader(ahead: Corridor, station: float, speed: float) -> Prediction:
    """A vehicle on the route's lane, predicted at constant speed."""
    time = jnp.linspace(0.0, 8.0, 17)
    position, heading, _ = to_world(ahead, station + speed * time, offset=jnp.zeros_like(time))
    return as_arrays(
        Prediction(
            position=position[None],
            heading=heading[None],
            speed=jnp.full(1, speed),
            length=jnp.full(1, 4.7),
            width=jnp.full(1, 1.9),
            time=time,
            valid=jnp.ones(1, bool),
        )
    )


def _box(position: Any, heading: Any, vehicle: VehicleParams) -> np.ndarray:
    """The ego's box [1, 5] from the pose of its rear axle."""
    ahead = float(vehicle.centre_offset) * np.array([np.cos(heading), np.sin(heading)])
    return np.r_[np.asarray(position) + ahead, float(heading), float(vehicle.length), float(vehicle.width)][None]


_macro = jax.jit(lambda situation, driving, previous: macro.plan(situation, driving, previous=previous))
