"""The command line of every experiment: Hydra in front, checked params behind, errors in one line."""

import contextlib
import functools
import importlib.util
import inspect
import os
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from urbanjax.io.runs import completion, messages, parameter_file, presets, shown
from urbanjax.io.runs.directory import Run
from urbanjax.io.runs.evaluations import Evaluation
from urbanjax.io.runs.program import Body, Program, stop
from urbanjax.types import UrbanJaxError
from urbanjax.types import config as configs

T = TypeVar("T")


def experiment(
    name: str,
    params_class: type[T],
    *,
    evaluation: Callable[[T, Run], Evaluation] | None = None,
    anew: bool = False,
) -> Callable[[Body], Callable[[], None]]:
    """A decorator that makes a command-line program of `body(params, run)`.

    `--cfg job` shows every value of `params_class`; any can be overridden (`stack.gvp.tau=1`), swept (`-m`) or set
    by a file of `configs/<name>/preset/` (`preset=smoke`). What the user got wrong ends in one line and exit code 2.
    Args: name of the program, its presets and its runs; params_class, a pytree of its parameters; evaluation, where the
    body evaluates drives: what it drives, so that the jobs of a sweep share programs; anew, whether it compiles all of
    its programs, as one that measures how long that takes: no other run's are used.
    """

    def decorate(body: Body) -> Callable[[], None]:
        @functools.wraps(body)
        def program() -> None:
            folder = Path(inspect.getfile(inspect.unwrap(body))).resolve().parents[2] / "configs" / name
            tree, folders = configs.schema(params_class), [folder]
            try:
                asked = messages.check_arguments(sys.argv[1:])
                folders += [Path(asked.config_dir)] if asked.config_dir else []
                if asked.shell_completion and asked.overrides == completion.QUERY:
                    print("\n".join(completion.completions(params_class(), folders=folders)))
                    return
                for path in presets.named(asked.overrides, folders[::-1]):
                    presets.check(path)
                with shown.readable(name, asked.package) if asked.cfg else contextlib.nullcontext():
                    _launch(Program(name, params_class, body, evaluation=evaluation, anew=anew), tree, folder)
            except UrbanJaxError as error:
                stop(str(error))
            except Exception as error:
                message = None if _is_own(error) else messages.message_of(error, tree, folders=folders)
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
            "help": {"template": shown.help_text(program.name, tree, folder=folder, about=_about(program.name))},
            "run": {"dir": directory + "/${now:%Y-%m-%d_%H-%M-%S}"},
            "sweep": {"dir": directory + "/sweeps", "subdir": "${hydra.job.num}"},
        },
        parameter_file.KEY: "",
        **tree,
    }
    ConfigStore.instance().store(name=program.name, node=node)
    folder = folder if folder.is_dir() else Path(__file__).parent  # Hydra wants a folder, also without presets
    hydra.main(version_base="1.3", config_path=str(folder), config_name=program.name)(program)()


def _about(name: str) -> str:
    """What an experiment says of itself: the docstring of the module that is run."""
    return sys.modules["__main__"].__doc__ or name


def _plugins(program: Program) -> list[dict[str, str]]:
    """Sweeper and launcher of the project, where they are there: the experiments' folder holds them, no wheel does."""
    if not importlib.util.find_spec("hydra_plugins") or not importlib.util.find_spec("hydra_plugins.urbanjax_sweeps"):
        return []
    launcher = [{"override hydra/launcher": "vmap"}] if program.evaluation else []
    return [{"override hydra/sweeper": "design"}, *launcher]


def _is_own(error: Exception) -> bool:
    """Whether an error comes out of the experiment itself and not out of what reads its configuration."""
    called = inspect.unwrap(Program.__call__).__code__  # checks of types may be wrapped around it
    return any(frame.f_code is called for frame, _ in traceback.walk_tb(error.__traceback__))
