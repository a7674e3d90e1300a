import jax
import jax.numpy as jnp
import pytest

from tests.evaluation.test_metrics import VEHICLE, L, W, make
from urbanjax.evaluation import collisions
from urbanjax.evaluation.collisions import Contact

first = jax.jit(collisions.first)
CLOSE = L - 0.1  # centres this far apart in line touch


@pytest.mark.parametrize(
    ("other", "ego_speed", "contact", "at_fault"),
    [
        ((20.0, 0.0, 0.0, 5.0), 10.0, Contact.NONE, False),
        ((CLOSE, 0.0, 0.0, 5.0), 10.0, Contact.FRONT, True),
        ((CLOSE, 0.0, jnp.pi, 5.0), 10.0, Contact.FRONT, True),
        ((CLOSE, 0.0, 0.0, 0.0), 10.0, Contact.STANDING_OTHER, True),
        ((-CLOSE, 0.0, 0.0, 12.0), 10.0, Contact.REAR, False),
        ((-CLOSE, 0.0, 0.0, 8.0), 10.0, Contact.SIDE, True),
        ((0.0, W - 0.1, 0.0, 10.0), 10.0, Contact.FRONT, True),
        ((-1.0, W - 0.1, 0.0, 10.0), 10.0, Contact.SIDE, True),
        ((-CLOSE, 0.0, 0.0, 12.0), 0.0, Contact.STANDING, False),
        ((CLOSE, 0.0, jnp.pi, 5.0), 0.0, Contact.STANDING, False),
    ],
)
def test_whose_fault(other, ego_speed, contact, at_fault):
    found = first(make([0.0], ego_speed=ego_speed, others=[other]), VEHICLE)
    assert Contact(int(found.contact)) == contact
    assert bool(found.at_fault) == at_fault


def test_the_first_contact_counts():
    others = [(30.0, 0.0, 0.0, 0.0), (14.0, W - 0.1, 0.0, 3.0)]
    found = first(make([0.0, 6.0, 12.0, 28.0], others=others), VEHICLE)
    assert int(found.step) == 2
    assert int(found.other) == 1
    assert Contact(int(found.contact)) == Contact.FRONT
    apart = first(make([0.0, 1.0], others=others), VEHICLE)
    assert int(apart.step) == 2
    assert not bool(apart.at_fault)


def test_who_is_not_there_is_not_touched():
    log = make([0.0], others=[(0.0, 0.0, 0.0, 5.0)])
    log = log.replace(traffic=log.traffic.replace(valid=jnp.zeros_like(log.traffic.valid)))
    assert Contact(int(first(log, VEHICLE).contact)) == Contact.NONE
