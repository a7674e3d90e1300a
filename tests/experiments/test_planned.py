"""One plan of one moment, drawn."""

import numpy as np
import pytest

from experiments.plan import figures
from experiments.plan import study as planned
from experiments.plan.study import PlanStudy
from urbanjax.planning.explain import explain
from urbanjax.planning.macro import MacroParams
from urbanjax.planning.params import PlanningParams
from urbanjax.planning.primitives import PrimitiveParams
from urbanjax.stack import StackParams
from urbanjax.types import ConfigError

SMALL = PlanStudy(
    stack=StackParams(
        planning=PlanningParams(
            macro=MacroParams(n_layers=8, nodes_per_lane=3),
            primitives=PrimitiveParams(n_points=21, offsets=(-0.5, 0.0, 0.5), durations=(3.0,)),
        )
    ),
    time=0.1,
)


@pytest.fixture(scope="module")
def found():
    return planned.moment(SMALL, lambda label: None)


def test_the_picture_is_in_the_egos_frame(found):
    turned = figures.seen_from_ego(found)
    np.testing.assert_allclose(turned.ego[:3], 0)
    axle = found.ego[3] / 2 - SMALL.vehicle.rear_overhang
    np.testing.assert_allclose(turned.hard.fan.position[:, 0], np.broadcast_to([-axle, 0.0], (6, 2)), atol=1e-3)
    before, after = (np.asarray(x.hard.fan.position) for x in (found, turned))
    lengths = [np.linalg.norm(np.diff(x, axis=1), axis=-1) for x in (before, after)]
    np.testing.assert_allclose(*lengths, atol=1e-3)


def test_it_is_drawn_and_explained(found, tmp_path):
    figures.draw(found, tmp_path / "plan.png")
    assert (tmp_path / "plan.png").stat().st_size > 20_000
    assert explain(found.hard)["candidates rejected"][0] == 6
    marginal = np.asarray(found.soft.macro.marginal)
    np.testing.assert_allclose(marginal.sum(axis=1), 1, atol=1e-5)


def test_a_map_without_traffic_is_refused(tmp_path):
    path = tmp_path / "track.csv"
    corners = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    rows = [f"{100 * np.cos(a):.3f},{100 * np.sin(a):.3f},5.0,5.0" for a in corners]
    path.write_text("\n".join(["# x_m,y_m,w_tr_right_m,w_tr_left_m", *rows]) + "\n")
    with pytest.raises(ConfigError, match=r"track\.csv holds no recorded traffic"):
        planned.moment(PlanStudy(file=str(path)), lambda label: None)
