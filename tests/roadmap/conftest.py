"""Road graphs that the tests of this room share."""

import numpy as np
import pytest

from urbanjax.roadmap import builders


@pytest.fixture(scope="session")
def district():
    return builders.district()


@pytest.fixture(scope="session")
def crossing():
    return builders.intersection(n_points=16)


@pytest.fixture(scope="session")
def road():
    """Two sections of three lanes."""
    return builders.straight(n_lanes=3, length=200.0, section=100.0, n_points=8)


@pytest.fixture(scope="session")
def graphs(district, crossing, road):
    """One graph of each kind."""
    return {
        "straight": road,
        "two_way": builders.two_way(length=200.0, n_points=8),
        "coinciding": builders.two_way(length=200.0, coinciding=True, n_points=8),
        "curve": builders.curve(radius=40.0, n_points=16),
        "merge": builders.merge(n_points=16),
        "crossing": crossing,
        "district": district,
    }


@pytest.fixture(scope="session")
def course_links(district):
    """The links of the district's leftmost lane, in driving direction."""
    successor = np.asarray(district.successor)
    links = [0]
    while (following := int(successor[links[-1], 0])) != 0:
        links.append(following)
    return links
