"""The command line of every experiment: Hydra in front, checked params behind, errors in one line."""

import functools
import importlib.util
import inspect
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from urbanjax.io.runs import parameter_file
from urbanjax.io.runs.directory import Run
from urbanjax.io.runs.evaluations import Evaluation
from urbanjax.io.runs.program import Body, Program, stop
from urbanjax.types import UrbanJaxError
from urbanjax.types import config as configs

T = TypeVar("T")
SHOWN = 12  # names in a message


def experiment(
    name: str, params_class: type[T], *, evaluation: Callable[[T, Run], Evaluation] | None = None
) -> Callable[[Body], Callable[[], None]]:
    """A decorator that makes a command-line program of `body(params, run)`.

    `--cfg job` shows every value of `params_class`; any can be overridden (`stack.gvp.tau=1`), swept (`-m`) or set
    by a file of `configs/<name>/preset/` (`preset=smoke`). What the user got wrong ends in one line and exit code 2.
    Args: name of the program, its presets and its runs; params_class, a pytree of its parameters; evaluation, where the
    body evaluates drives: what it drives, so that the jobs of a sweep share programs.
    """

    def decorate(body: Body) -> Callable[[], None]:
        @functools.wraps(body)
        def program() -> None:
            folder = Path(inspect.getfile(inspect.unwrap(body))).resolve().parents[2] / "configs" / name
            tree = configs.schema(params_class)
            try:
                _launch(Program(name, params_class, body, evaluation), tree, folder)
            except UrbanJaxError as error:
                stop(str(error))
            except Exception as error:
                message = _hydra_message(error, tree, folder)
                if message is None:
                    raise
                stop(message)

        return program

    return decorate


def _launch(program: Program, tree: dict[str, Any], folder: Path) -> None:
    import hydra
    from hydra.core.config_store import ConfigStore

    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra then raises what it would print with a traceback
    directory = f"outputs/{program.name}"
    node = {
        "defaults": [
            "_self_",
            {"preset": None},
            {"override hydra/job_logging": "none"},
            {"override hydra/hydra_logging": "none"},
            *_plugins(program),
        ],
        "hydra": {
            "job": {"name": program.name, "chdir": False},
            "output_subdir": None,
            "run": {"dir": directory + "/${now:%Y-%m-%d_%H-%M-%S}"},
            "sweep": {"dir": directory + "/sweeps", "subdir": "${hydra.job.num}"},
        },
        parameter_file.KEY: "",
        **tree,
    }
    ConfigStore.instance().store(name=program.name, node=node)
    folder = folder if folder.is_dir() else Path(__file__).parent  # Hydra wants a folder, also without presets
    hydra.main(version_base="1.3", config_path=str(folder), config_name=program.name)(program)()


def _plugins(program: Program) -> list[dict[str, str]]:
    """Sweeper and launcher of the project, where they are there: the experiments' folder holds them, no wheel does."""
    if importlib.util.find_spec("hydra_plugins.urbanjax_sweeps") is None:
        return []
    launcher = [{"override hydra/launcher": "vmap"}] if program.evaluation else []
    return [{"override hydra/sweeper": "design"}, *launcher]


def _hydra_message(error: Exception, tree: dict[str, Any], folder: Path) -> str | None:
    """One line for an error of Hydra or OmegaConf, None for any other error."""
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    if not isinstance(error, HydraException | OmegaConfBaseException):
        return None
    lines = [line for line in str(error).splitlines() if line.strip()]
    unknown = re.search(r"Could not override '([^']+)'", lines[0]) if lines else None
    if unknown:
        key = unknown.group(1)
        return f"unknown key '{key}' on the command line{configs.nearest(key, configs.keys(tree))}"
    told = _override_message(error, lines, tree) or _preset_message(lines, folder)
    if told:
        return told
    cause = error.__cause__
    detail = str(cause).splitlines()[0] if isinstance(cause, OmegaConfBaseException) else ""
    return " ".join([*lines[:1], detail]).strip() or type(error).__name__


def _override_message(error: Exception, lines: list[str], tree: dict[str, Any]) -> str | None:
    """What is wrong with one argument of the command line, None where that is not what the error is about."""
    from hydra.errors import OverrideParseException

    if isinstance(error, OverrideParseException):
        key = error.override.partition("=")[0]
        known = f" such as '{key}=VALUE'" if key in set(configs.keys(tree)) else ""
        how = "; what holds any of {}[],: needs quotes of its own, as in 'key=\"a{b\"'" if "=" in error.override else ""
        return f"cannot read {error.override!r} on the command line: write KEY=VALUE{known}{how} ({lines[0]})"
    merged = re.match(r"Error merging override ([^=]+)=(.*)", lines[0]) if lines else None
    group: Any = tree
    for name in merged.group(1).lstrip("+").split(".") if merged else ():
        group = group.get(name) if isinstance(group, dict) else None
    if merged and isinstance(group, dict) and group:
        names = ", ".join(f"{merged.group(1)}.{name}" for name in list(group)[:SHOWN])
        return f"'{merged.group(1)}' is a group of values, not {merged.group(2)}: set one of {names}"
    return None


def _preset_message(lines: list[str], folder: Path) -> str | None:
    """Which presets there are, None where the error is about something else."""
    absent = re.search(r"Could not find 'preset/([^']+)'", " ".join(lines))
    if absent is None:
        return None
    names = sorted(path.stem for path in (folder / "preset").glob("*.yaml"))
    return f"there is no preset '{absent.group(1)}': use one of {', '.join(names)}" if names else "there are no presets"
