"""The reference line of a route."""

import jax.numpy as jnp
import numpy as np

from urbanjax.planning.frenet_sampling.line import along_route, look_up


def test_the_line_of_a_route_is_the_road(scenes):
    window = scenes.road(curvature=0.02, origin=(3.0, -2.0), heading=0.4)
    station = np.array([0.0, 7.3, 100.9])
    foot = look_up(along_route(window), jnp.asarray(station))
    for i, s in enumerate(station):
        position, heading = scenes.place(window, s, 0.0)
        np.testing.assert_allclose([foot.x[i], foot.y[i]], position, atol=1e-4)
        np.testing.assert_allclose(foot.heading[i], heading, atol=1e-5)
    assert not np.any(foot.outside)
    ends = look_up(along_route(window), jnp.asarray([-2.0, 223.0]))
    np.testing.assert_array_equal(ends.outside, True)
    ahead = np.array([ends.x[1], ends.y[1]]) - np.asarray(window.position[-1])
    np.testing.assert_allclose(np.hypot(*ahead), 3.0, rtol=1e-4)
