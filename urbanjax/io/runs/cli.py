"""The command line of every experiment: Hydra in front, checked params behind, errors in one line."""

import contextlib
import functools
import inspect
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from urbanjax.io.runs import directory, processes
from urbanjax.types import ConfigError, UrbanJaxError, unread
from urbanjax.types import config as configs

T = TypeVar("T")
SHOWN = 12  # names in a message
Body = Callable[[T, directory.Run], None]


def experiment(name: str, params_class: type[T]) -> Callable[[Body], Callable[[], None]]:
    """A decorator that makes a command-line program of `body(params, run)`.

    `--cfg job` shows every value of `params_class`; any can be overridden (`stack.gvp.tau=1`), swept (`-m`) or set
    by a file of `configs/<name>/preset/` (`preset=smoke`). What the user got wrong ends in one line and exit code 2.
    Args: name of the program, its presets and its runs; params_class, a pytree of its parameters.
    """

    def decorate(body: Body) -> Callable[[], None]:
        @functools.wraps(body)
        def program() -> None:
            folder = Path(inspect.getfile(inspect.unwrap(body))).resolve().parents[2] / "configs" / name
            tree = configs.schema(params_class)
            try:
                _launch(name, tree, folder, functools.partial(_task, params_class, body))
            except UrbanJaxError as error:
                _stop(str(error))
            except Exception as error:
                message = _hydra_message(error, tree, folder)
                if message is None:
                    raise
                _stop(message)

        return program

    return decorate


def _stop(message: str) -> None:
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(2)


def _launch(name: str, tree: dict[str, Any], folder: Path, task: Callable[[Any], None]) -> None:
    import hydra
    from hydra.core.config_store import ConfigStore

    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra then raises what it would print with a traceback
    directory = f"outputs/{name}"
    node = {
        "defaults": [
            "_self_",
            {"preset": None},
            {"override hydra/job_logging": "none"},
            {"override hydra/hydra_logging": "none"},
        ],
        "hydra": {
            "job": {"name": name, "chdir": False},
            "output_subdir": None,
            "run": {"dir": directory + "/${now:%Y-%m-%d_%H-%M-%S}"},
            "sweep": {"dir": directory + "/${now:%Y-%m-%d_%H-%M-%S}", "subdir": "${hydra.job.num}"},
        },
        **tree,
    }
    ConfigStore.instance().store(name=name, node=node)
    folder = folder if folder.is_dir() else Path(__file__).parent  # Hydra wants a folder, also without presets
    hydra.main(version_base="1.3", config_path=str(folder), config_name=name)(task)()


def _task(params_class: type[T], body: Body, config: Any) -> None:
    from hydra.core.hydra_config import HydraConfig

    runtime, typed = HydraConfig.get().runtime, HydraConfig.get().overrides.task
    folder = Path(runtime.output_dir)
    try:  # ends the program from inside: what leaves a Hydra job as an exception is reported by Hydra too
        values, params = _read(params_class, config, runtime)
        keys = [text.partition("=")[0].lstrip("+~") for text in typed]
        unread.check_read(params, [*keys, *unread.changed(values, configs.schema(params_class))])
        record = processes.recorder(values)
        with record(folder, values, seed=values.get("seed")) as run:
            body(params, run)
    except UrbanJaxError as error:
        with contextlib.suppress(OSError):
            folder.rmdir()  # nothing was written
        _stop(str(error))


def _read(params_class: type[T], config: Any, runtime: Any) -> tuple[dict[str, Any], T]:
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    try:
        values: Any = OmegaConf.to_container(config, resolve=True)
    except OmegaConfBaseException as error:
        raise ConfigError(str(error).splitlines()[0]) from error
    return values, configs.to_params(params_class, values, source=_source(values, params_class, runtime))


def _source(values: dict[str, Any], params_class: type, runtime: Any) -> str:
    """The preset file that brought a key which the class does not have, for the message; empty when none did."""
    preset = runtime.choices.get("preset")
    unknown = set(configs.keys(values)) - set(configs.keys(configs.schema(params_class)))
    if not preset or not unknown:
        return ""
    folders = [Path(source.path) for source in runtime.config_sources if source.schema == "file"]
    files = [folder / "preset" / f"{preset}.yaml" for folder in folders]
    return next((os.path.relpath(file) for file in files if file.is_file()), "")


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
