"""`hydra/sweeper=design`: the values that are asked, a directory that goes on where it stopped, a report at the end."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.core.plugins import Plugins
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig

TRIED = 5  # jobs


@dataclass
class DesignSweeperConf:
    """What the command line can say of it."""

    _target_: str = "hydra_plugins.urbanjax_sweeps.design_sweeper.DesignSweeper"
    seed: int = 0  # of sampled values
    params: dict[str, str] = field(default_factory=dict)  # values by key, as on the command line


ConfigStore.instance().store(group="hydra/sweeper", name="design", node=DesignSweeperConf, provider="urbanjax")


class DesignSweeper(Sweeper):
    """Plans a sweep, has a launcher do what is left of it, and reports on the whole."""

    def __init__(self, seed: int, params: dict[str, str]) -> None:
        """A sweeper that samples with a seed, of params that stand before those of the command line."""
        self.seed, self.params = seed, params

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Keep what Hydra says. Args: hydra_context; task_function, a `Program`; config, of the whole sweep."""
        self.context: Any = hydra_context
        self.program: Any = task_function
        self.config: Any = config

    def sweep(self, arguments: list[str]) -> None:
        """Do what is left of the sweep, and report. Raises UrbanJaxError in the end where jobs have failed."""
        from experiments.collect.report import write_sweep
        from urbanjax.io.runs.sweeps import axes, plan, running

        fixed, asked = self._asked([*(f"{key}={value}" for key, value in self.params.items()), *arguments])
        found = axes.axes_of({key: [value for value, _ in values] for key, values in asked.items()}, seed=self.seed)
        texts = {key: {repr(value): text for value, text in values} for key, values in asked.items()}
        jobs = axes.jobs_of(found)
        base, resolved = running.configs_of(self.program, self.config, keys=list(asked))
        groups = {key: self._composed(fixed, key, asked[key]) for key in asked if key in running.GROUPS}
        resolved |= {"hydra.sweeper.params": dict(self.params)} if self.params else {}
        contents = running.contents_of(self.program, found, jobs=jobs, base=resolved, groups=groups)
        planned = plan.plan_of(self.program.name, base, axes=found, jobs=jobs, contents=contents, fixed=fixed)
        folder = Path(self.config.hydra.sweep.dir) / planned.sweep

        def overrides(job: plan.PlannedJob) -> list[str]:
            values = [f"{key}={texts[key].get(repr(value), repr(value))}" for key, value in job.overrides.items()]
            return [*fixed, *values, f"hydra.sweep.subdir={planned.sweep}/{job.name}"]

        def launch(left: Sequence[plan.PlannedJob]) -> None:
            launcher = Plugins.instance().instantiate_launcher(
                hydra_context=self.context, task_function=self.program, config=self.config
            )
            launcher.launch([overrides(job) for job in left], initial_job_idx=0)

        self._check([overrides(job) for job in planned.jobs[:TRIED]])
        running.run(planned, folder, launch=launch, report=write_sweep, process=int(self.config.get("process", 0)))

    def _check(self, jobs: Sequence[Sequence[str]]) -> None:
        """Raise what is wrong with the first job, where it is wrong with others too: the sweep is a mistake."""
        from urbanjax.types import ConfigError

        wrong: list[ConfigError] = []
        for texts in jobs:
            config = self.context.config_loader.load_sweep_config(self.config, list(texts))
            try:
                self.program.read(config, config.hydra)
                return
            except ConfigError as error:
                wrong.append(error)
        raise wrong[0]

    def _asked(self, arguments: Sequence[str]) -> tuple[list[str], dict[str, list[tuple[Any, str]]]]:
        """What is the same in all jobs, as typed, and the values of each key with what stands for them."""
        from urbanjax.io.runs.sweeps.axes import stands_for_several
        from urbanjax.types import ConfigError

        parser = OverridesParser.create(config_loader=self.context.config_loader)
        fixed: dict[str, str] = {}
        asked: dict[str, list[tuple[Any, str]]] = {}
        for one in parser.parse_overrides(list(arguments)):
            key = one.key_or_group
            fixed.pop(key, None)
            asked.pop(key, None)
            if one.is_sweep_override() or stands_for_several(one.value()):
                if "shuffle(" in str(one.input_line):
                    raise ConfigError(f"{one.input_line}: the order of jobs says nothing; leave shuffle() out")
                asked[key] = [(parser.parse_override(f"{key}={text}").value(), text) for text in _texts(one)]
            else:
                fixed[key] = str(one.input_line)
        return list(fixed.values()), asked

    def _composed(self, fixed: Sequence[str], key: str, values: Sequence[tuple[Any, str]]) -> dict[str, Any]:
        """What every choice of a config group comes to, by its `repr`."""
        from urbanjax.io.runs.sweeps.running import content_of

        load = self.context.config_loader.load_sweep_config
        composed = {repr(value): load(self.config, [*fixed, f"{key}={text}"]) for value, text in values}
        return {name: content_of(self.program, one) for name, one in composed.items()}


def _texts(override: Override) -> Iterator[str]:
    """The values of an override as they would be typed."""
    from urbanjax.types import ConfigError

    if not override.is_sweep_override():
        yield str(override.value())
        return
    if not override.is_discrete_sweep():
        raise ConfigError(
            f"{override.input_line}: an interval says not which values; write linspace:LOW:HIGH:N or sobol:LOW:HIGH:N"
        )
    yield from override.sweep_string_iterator()
