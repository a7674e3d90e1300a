"""No experiment takes a value that it does not read, and none complains of its own defaults and presets."""

import fnmatch
import importlib

import jax
import jax.numpy as jnp
import pytest
import yaml
from jax.extend.core.primitives import custom_jvp_call_p
from jax.interpreters import partial_eval

from experiments.benchmark.study import BenchStudy
from experiments.candidates.study import CandidateStudy
from experiments.collect.study import CollectStudy
from experiments.common import overtaking
from experiments.common.overtaking import OvertakeStudy
from experiments.demo.study import DemoStudy
from experiments.evaluate.study import EvaluateStudy
from experiments.highway.study import HighwayStudy
from experiments.localize.study import LocalizeStudy
from experiments.map.study import MapStudy
from experiments.parameters.study import ParameterStudy
from experiments.plan.study import PlanStudy
from experiments.racetrack.study import RacetrackStudy
from experiments.recorded.study import RecordedStudy
from experiments.register.study import RegisterStudy
from experiments.traffic.study import TrafficStudy
from experiments.tune.study import TuneStudy
from tests.conftest import REPOSITORY
from urbanjax.evaluation import metrics
from urbanjax.rollout import rollout
from urbanjax.sim.scenarios import overtake
from urbanjax.types import ConfigError, as_arrays, config
from urbanjax.types.unread import changed, check_read, unread

STUDIES = {
    "benchmark": BenchStudy,
    "candidates": CandidateStudy,
    "collect": CollectStudy,
    "demo": DemoStudy,
    "evaluate": EvaluateStudy,
    "highway": HighwayStudy,
    "localize": LocalizeStudy,
    "map": MapStudy,
    "overtake": OvertakeStudy,
    "parameters": ParameterStudy,
    "plan": PlanStudy,
    "racetrack": RacetrackStudy,
    "recorded": RecordedStudy,
    "register": RegisterStudy,
    "traffic": TrafficStudy,
    "tune": TuneStudy,
}
TAU = "stack.behavior.gvp.tau"
SIGMA = "stack.planning.micro.choice_scale"
# Experiment, what is set, and the key that nothing then reads.
MISTAKES = [
    ("overtake", {}, TAU),
    ("demo", {}, f"overtake.{TAU}"),
    ("traffic", {}, f"rollouts.{TAU}"),
    ("localize", {}, f"loop.{TAU}"),
    ("overtake", {}, "stack.lidar.sensing_radius"),
    ("evaluate", {}, "idm.margin"),
    ("evaluate", {"drivers": ["idm"]}, TAU),
    ("evaluate", {"replay": "x"}, "seeds"),
    ("evaluate", {"run": "x", "against": "y"}, TAU),
    ("evaluate", {}, "row"),
    ("evaluate", {}, "sensor.noise"),
    ("evaluate", {}, "stack.localizer"),
    ("evaluate", {}, "stack.search.starts"),
    ("localize", {}, "loop.stack.search.starts"),
    ("overtake", {"stack": {"localizer": "lidar"}}, "stack.search.starts"),
    ("evaluate", {"replay": "x", "localization": ["scans"]}, "sensor.noise"),
    ("evaluate", {}, "egos"),
    ("evaluate", {"scenes": ["x"], "egos": "problems"}, "shortest"),
    ("overtake", {}, "sensor.noise"),
    ("overtake", {}, "sensor.pattern"),
    ("overtake", {}, "stack.relaxation.temperature"),
    ("overtake", {}, SIGMA),
    ("localize", {}, "loop.stack.lidar.sensing_radius"),
    ("localize", {}, "poses"),
    ("localize", {"folder": "scans"}, "world.stretch"),
    ("localize", {"folder": "scans"}, "localizer.align.max_iterations"),
    ("localize", {"map": "map.npz"}, "world.mapping.spacing"),
    ("localize", {}, "world.mapping.drive.vehicles"),
    ("register", {}, "localizer.start"),
    ("register", {}, "world.mapping.distributions.resolution"),
    ("register", {"pair": {"use": False}}, "pair.speed.repeats"),
    ("highway", {"drivers": ["IDM"]}, TAU),
    ("recorded", {"egos": "problems"}, "shortest"),
    ("recorded", {}, "sim.traffic.idm.time_headway"),
    ("plan", {}, "ego"),
    ("plan", {"file": "map.xml"}, "scenario.gap"),
    ("plan", {"file": "map.xml"}, "vehicle.length"),
    ("racetrack", {}, "lattice.n_layers"),
    ("racetrack", {}, "vehicle.max_speed"),
    ("candidates", {}, "vehicle.length"),
    ("traffic", {}, "rollouts.gif_every"),
    ("traffic", {}, "format.layout"),
    ("traffic", {}, "platoon.moving"),
    ("traffic", {"files": ["a.csv"]}, "rollouts.starts"),
    ("traffic", {"files": ["a.csv"], "analysis": "platoons"}, "teams.spacing"),
    ("traffic", {"analysis": "offset"}, "files"),
    ("tune", {}, "pareto.points"),
    ("tune", {}, "stack.relaxation.mode"),
    ("tune", {"task": "budget"}, "tested.seeds"),
    ("tune", {"task": "imitation"}, "training.rate"),
]
READ = [
    ("overtake", {}, "taus"),
    ("overtake", {}, "stack.behavior.gvp.clamp_time"),
    ("overtake", {"stack": {"relaxation": {"mode": "soft"}}}, SIGMA),
    ("overtake", {"stack": {"localizer": "lidar"}}, "sensor.noise"),
    ("plan", {}, SIGMA),
    ("highway", {}, TAU),
    ("plan", {}, TAU),
    ("recorded", {}, TAU),
    ("evaluate", {"scenes": ["x"]}, "egos"),
    ("evaluate", {"localization": ["scans"]}, "sensor.noise"),
    ("evaluate", {"localization": ["given", "kidnapping"]}, "stack.search.starts"),
    ("evaluate", {"scenes": ["x"]}, "shortest"),
    ("benchmark", {}, TAU),
    ("tune", {}, SIGMA),
    ("tune", {"task": "horizons"}, "learned.missions"),
    ("localize", {}, "localizer.align.max_iterations"),
    ("traffic", {"files": ["a.csv"], "analysis": "platoons"}, "safety.ttc_threshold"),
]


@pytest.mark.parametrize(("name", "values", "key"), MISTAKES, ids=lambda part: str(part))
def test_a_value_that_nothing_reads_is_refused(name, values, key):
    with pytest.raises(ConfigError, match=f"'{key}' is read by nothing here: .+"):
        check_read(config.to_params(STUDIES[name], values), [key])


@pytest.mark.parametrize(("name", "values", "key"), READ, ids=lambda part: str(part))
def test_a_value_that_is_read_passes(name, values, key):
    check_read(config.to_params(STUDIES[name], values), [key])


@pytest.mark.parametrize("name", STUDIES)
def test_defaults_and_presets_pass_and_every_rule_is_of_a_key(name):
    study, tree = STUDIES[name], config.schema(STUDIES[name])
    keys = set(config.keys(tree))
    for pattern in unread(study()):
        assert any(fnmatch.fnmatchcase(key, pattern) for key in keys), pattern
    for preset in sorted((REPOSITORY / "configs" / name / "preset").glob("*.yaml")):
        values = yaml.safe_load(preset.read_text(encoding="utf-8"))
        params = config.to_params(study, values)
        check_read(params, changed(config.plain(params), tree))


def test_every_experiment_is_looked_at():
    folders = {path.parent.name for path in (REPOSITORY / "experiments").glob("*/__main__.py")}
    assert folders == set(STUDIES)
    for name in folders:
        assert importlib.import_module(f"experiments.{name}.__main__")


def within(used, equation):
    """Which inputs of a function with a derivative of its own matter, where by itself JAX takes all of them to."""
    if not any(used):
        return [False] * len(equation.invars), None
    inner = equation.params["call_jaxpr"].jaxpr
    return partial_eval.dce_jaxpr(inner, list(used))[1], equation


@pytest.mark.parametrize("mode", ["soft", pytest.param("hard", marks=pytest.mark.slow)])
def test_what_the_overtaking_program_does_not_depend_on_is_what_is_said(mode, monkeypatch):
    monkeypatch.setitem(partial_eval.dce_rules, custom_jvp_call_p, within)
    study = config.to_params(OvertakeStudy, {"starts": 1, "stack": {"relaxation": {"mode": mode}}})
    mission = overtaking.mission_of(study)
    case = jax.tree.map(jnp.asarray, mission.case(0, others=study.sim.traffic, vehicle=study.vehicle))
    every_tau = jnp.ones(())

    def program(loop):
        scenario = overtake.sample(
            jax.random.key(0), as_arrays(study.scenario), vehicle=loop.vehicle, others=loop.sim.traffic
        )
        behavior = loop.stack.behavior
        stack = loop.stack.replace(behavior=behavior.replace(gvp=behavior.gvp.replace(tau=every_tau)))
        log, _ = rollout(loop.replace(stack=stack), case.course, case.lanes, case.start, n_steps=2)
        return scenario, log, metrics.evaluate(log, loop.vehicle, relaxation=stack.relaxation)

    loop = as_arrays(study.loop())
    traced = jax.make_jaxpr(program)(loop).jaxpr
    _, used = partial_eval.dce_jaxpr(traced, [True] * len(traced.outvars))
    paths = [jax.tree_util.keystr(path)[1:] for path, _ in jax.tree_util.tree_flatten_with_path(loop)[0]]
    keys = {path for path in paths if "[" not in path}
    rules = [pattern for pattern, why in unread(study).items() if why]
    said = {key for key in keys for rule in rules if fnmatch.fnmatchcase(key, rule) or key.startswith(f"{rule}.")}
    assert said == {path for path, is_used in zip(paths, used, strict=True) if not is_used and path in keys}
