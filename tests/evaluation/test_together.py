"""Drives of several evaluations: which share a call, whose are whose, and whose error it is."""

import dataclasses

import pytest

from urbanjax.drivers import IdmDriver, Standstill
from urbanjax.evaluation import together as rooms
from urbanjax.evaluation.batch import Job, Outcome
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.together import Batch, Wanted, together
from urbanjax.rollout import LoopParams

CUT_IN, OVERTAKE, DISTRICT = (MISSIONS[name] for name in ("cut_in", "overtake", "district"))


@pytest.fixture
def calls(monkeypatch):
    """The calls of `outcomes`, which here come to who drives which seed, and raise for a margin of 13."""
    made = []

    def outcomes(loops, jobs, **settings):
        made.append((list(jobs), settings))
        for job in jobs:
            margin = getattr(loops[job.params].driver, "margin", None)
            if margin == 13:
                raise ValueError("thirteen")
            yield Outcome(job, {"margin": margin, "seed": job.seed, "mission": job.mission.name, "params": job.params})

    monkeypatch.setattr(rooms, "outcomes", outcomes)
    return made


def batch(*margins, missions=(CUT_IN,), seeds=3, **settings):
    loops = tuple(LoopParams(driver=IdmDriver(margin=margin)) for margin in margins)
    jobs = tuple(Job(one, seed, k) for one in missions for k in range(len(loops)) for seed in range(seeds))
    return Batch("idm-idm", loops, jobs, **settings)


def wanted(name, one):
    return [Wanted(name, one, part) for part in one.parts]


def test_parts_hold_drives_of_one_mission_and_at_most_a_chunk():
    parts = batch(0.5, missions=(CUT_IN, OVERTAKE), seeds=20).parts
    assert {name: len(jobs) for name, jobs in parts.items()} == {
        "idm-idm-cut_in-00000": 16,
        "idm-idm-cut_in-00001": 4,
        "idm-idm-overtake-00000": 16,
        "idm-idm-overtake-00001": 4,
    }


def test_evaluations_that_differ_in_values_share_a_call_and_keep_their_own(calls):
    found = list(together([*wanted("a", batch(0.1)), *wanted("b", batch(0.2, 0.3, seeds=2))]))
    assert len(calls) == 1
    assert [job.params for job in calls[0][0]] == [0, 0, 0, 1, 1, 2, 2]
    a, b = found
    assert [one.row["margin"] for one in a.outcomes] == [0.1, 0.1, 0.1]
    assert all("params" not in one.row for one in a.outcomes)
    assert [(one.row["margin"], one.row["params"], one.job.params) for one in b.outcomes] == [
        (0.2, 0, 0),
        (0.2, 0, 0),
        (0.3, 1, 1),
        (0.3, 1, 1),
    ]


@pytest.mark.parametrize(
    "other",
    [
        batch(0.1, traffic="mixed"),
        batch(0.1, chunk=8),
        batch(0.1, logs=True),
        dataclasses.replace(batch(0.1), loops=(LoopParams(driver=Standstill()),)),
        dataclasses.replace(batch(0.1), loops=(LoopParams(driver=IdmDriver(margin=0.1), period=0.2),)),
    ],
    ids=["traffic", "chunk", "logs", "driver", "period"],
)
def test_what_needs_another_program_is_a_call_of_its_own(calls, other):
    found = list(together([*wanted("a", batch(0.1)), *wanted("b", other), *wanted("c", batch(0.4))]))
    assert [len(jobs) for jobs, _ in calls] == [6, 3]
    assert [one.wanted.evaluation for one in found] == ["a", "c", "b"]


def test_drives_of_one_size_stand_side_by_side(calls):
    missions = (CUT_IN, DISTRICT)
    assert CUT_IN.size != DISTRICT.size
    list(together([*wanted("a", batch(0.1, missions=missions)), *wanted("b", batch(0.2, missions=missions))]))
    assert [job.mission.name for job in calls[0][0]] == ["cut_in"] * 6 + ["district"] * 6


def test_an_evaluation_that_raises_ends_alone(calls):
    parts = [*wanted("a", batch(0.1)), *wanted("bad", batch(13, seeds=20)), *wanted("c", batch(0.4))]
    found = {}
    for one in together(parts):
        found.setdefault(one.wanted.evaluation, []).append(one)
    assert {name: [len(one.outcomes) for one in came] for name, came in found.items()} == {
        "a": [3],
        "bad": [0, 0],
        "c": [3],
    }
    assert [str(one.error) for one in found["bad"]] == ["thirteen", "thirteen"]
    assert not any(one.error for one in [*found["a"], *found["c"]])
