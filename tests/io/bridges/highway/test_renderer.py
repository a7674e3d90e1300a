"""highway-env draws our own rollouts."""

import numpy as np

from urbanjax.io.bridges.highway.renderer import EGO, OTHER, Renderer
from urbanjax.roadmap.builders import roads


def centre_of(picture, colour):
    """Mean (row, column) of the pixels of one colour."""
    return np.argwhere((picture == colour).all(-1)).mean(0)


def test_vehicles_appear_where_they_are():
    renderer = Renderer(roads.two_way(), width=400, height=100, scaling=5.0)
    position, size = np.array([[50.0, 0.0], [70.0, 3.5]]), np.array([[4.7, 1.9]] * 2)
    picture = renderer.picture(position, np.zeros(2), size)
    assert picture.shape == (100, 400, 3)
    ego, other = centre_of(picture, EGO), centre_of(picture, OTHER)
    assert np.abs(other - ego - [-3.5 * 5.0, 20.0 * 5.0]).max() < 4.0  # ahead is right, left is up
    moved = renderer.picture(position + np.array([[0.0, 0.0], [10.0, 0.0]]), np.zeros(2), size)
    assert abs(centre_of(moved, OTHER)[1] - other[1] - 50.0) < 2.0
    assert abs(centre_of(moved, EGO)[1] - ego[1]) < 1.0  # the picture follows the ego
    fixed = renderer.picture(position, np.zeros(2), size, camera=position[0] + [10.0, 0.0])
    assert abs(centre_of(fixed, EGO)[1] - ego[1] + 50.0) < 2.0


def test_the_road_is_drawn():
    picture = Renderer(roads.curve(), width=300, height=300).picture(np.zeros((1, 2)), np.zeros(1), np.ones((1, 2)))
    assert (picture == 255).all(-1).sum() > 100  # lane markings
