"""`hydra/launcher=vmap`: jobs of a sweep that differ in values of their parameters are drives of one program."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.utils import JobReturn, setup_globals
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig

SUBDIR = "hydra.sweep.subdir"


@dataclass
class VmapLauncherConf:
    """It has nothing to be set."""

    _target_: str = "hydra_plugins.urbanjax_sweeps.vmap_launcher.VmapLauncher"


ConfigStore.instance().store(group="hydra/launcher", name="vmap", node=VmapLauncherConf, provider="urbanjax")


class VmapLauncher(Launcher):
    """Does all jobs in this process, as one evaluation of many parameter sets."""

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Keep what Hydra says. Args: hydra_context; task_function, a `Program`; config, of the whole sweep."""
        self.context: Any = hydra_context
        self.program: Any = task_function
        self.config: Any = config

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
        """Do the jobs. Args: job_overrides, KEY=VALUE of each; initial_job_idx, the number of the first one.

        Raises ConfigError for an experiment that evaluates no drives.
        """
        from urbanjax.io.runs.sweeps import batched

        setup_globals()
        batched.do(self.program, list(self._jobs(job_overrides)))
        return []

    def _jobs(self, job_overrides: Sequence[Sequence[str]]) -> Iterator[Any]:
        """The jobs with their configs: composed once, and once more for every choice of a config group."""
        from urbanjax.io.runs.sweeps.batched import BatchedJob, changed_config
        from urbanjax.io.runs.sweeps.running import GROUPS

        loader = self.context.config_loader
        parser = OverridesParser.create(config_loader=loader)
        composed: dict[tuple[str, ...], Any] = {}
        for texts in job_overrides:
            parsed = parser.parse_overrides(list(texts))
            values = {one.key_or_group: one for one in parsed if one.key_or_group not in GROUPS}
            folder = Path(self.config.hydra.sweep.dir) / str(values.pop(SUBDIR).value())
            plain = all(not one.is_add() and not one.is_delete() for one in values.values())
            how = tuple(text for text in texts if text.partition("=")[0] in GROUPS) if plain else tuple(texts)
            if how not in composed:
                composed[how] = loader.load_sweep_config(self.config, list(how))
            told = {key: one.value() for key, one in values.items()} if plain else {}
            keys = [one.key_or_group for one in parsed if one.key_or_group != SUBDIR]
            yield BatchedJob(folder, changed_config(composed[how], told), keys)
