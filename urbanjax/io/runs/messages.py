"""One line for what is wrong on the command line or in a file of values, in the place of a dependency's traceback."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from urbanjax.io.runs import interpolation, presets
from urbanjax.io.runs.disk import of_disk
from urbanjax.types import ConfigError
from urbanjax.types import config as configs

SHOWN = 12  # names in a message
REFUSED = {  # options of Hydra, and why
    "experimental_rerun": "it runs whatever its file says",
    "config_name": "the values of an experiment are those of its params",
    "config_path": "the values of an experiment are those of its params",
}
INSTEAD = "put values of your own into DIR/preset/NAME.yaml, and give --config-dir=DIR preset=NAME"


def check_arguments(arguments: Sequence[str]) -> Any:
    """The arguments of a command line, read as Hydra does. Raises ConfigError where it does not know one.

    Args: arguments, without the name of the program.
    """
    from hydra._internal.utils import get_args_parser  # the one that `hydra.main` takes

    def refuse(message: str) -> NoReturn:
        raise ConfigError(f"{message}; --help says what there is")

    parser = get_args_parser()
    parser.error = refuse
    found = parser.parse_args(arguments)
    for option, why in REFUSED.items():
        if getattr(found, option) is not None:
            raise ConfigError(f"--{option.replace('_', '-')} is refused: {why}; {INSTEAD}")
    return found


def message_of(error: Exception, tree: Mapping[str, Any], *, folders: Sequence[Path]) -> str | None:
    """One line for an error of Hydra, OmegaConf or YAML, None for any other error.

    Args: error, as it was raised; tree, nested values with all the keys there are; folders in which
    folders of presets lie.
    """
    import yaml
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    if isinstance(error, yaml.YAMLError):
        return presets.problem_of(error)
    if not isinstance(error, HydraException | OmegaConfBaseException | OSError | UnicodeError | ValueError):
        return None
    lines = [line for line in str(error).splitlines() if line.strip()] or [type(error).__name__]
    told = _override_message(error, lines, tree) or _choice_message(lines, folders) or _file_message(lines, folders)
    if told:
        return told
    if isinstance(error, OmegaConfBaseException):
        return interpolation.unresolved(error)
    if isinstance(error, OSError) and error.filename:
        return of_disk(error, Path(error.filename))
    cause = error.__cause__ if isinstance(error.__cause__, OmegaConfBaseException) else None
    return " ".join([lines[0], interpolation.unresolved(cause) if cause else ""]).strip()


def _override_message(error: Exception, lines: list[str], tree: Mapping[str, Any]) -> str | None:
    """What is wrong with one argument of the command line, None where that is not what the error is about."""
    from hydra.errors import OverrideParseException

    if isinstance(error, OverrideParseException):
        return _unreadable(error.override, lines[0], tree)
    unknown = re.search(r"Could not override '([^']+)'", lines[0])
    if unknown:
        key = unknown.group(1)
        of_hydra = key.startswith("hydra.")
        right = "; --cfg hydra shows those" if of_hydra else configs.nearest(key, configs.keys(tree))
        return f"unknown key '{key}' on the command line{right}"
    several = re.match(r"Ambiguous value for argument '([^=']+)=([^']+)'", lines[0])
    if several:
        key, values = several.groups()
        return f"{key}={values} gives several values: add -m to run with each, or write the list '{key}=[{values}]'"
    merged = re.match(r"Error merging override ([^=]+)=(.*)", lines[0])
    return _of_group(merged[1], merged[2], tree) if merged else None


def _unreadable(override: str, why: str, tree: Mapping[str, Any]) -> str:
    key = override.partition("=")[0]
    known = f" such as '{key}=VALUE'" if key in set(configs.keys(tree)) else ""
    how = "; what holds any of {}[],: needs quotes of its own, as in 'key=\"a{b\"'" if "=" in override else ""
    return f"cannot read {override!r} on the command line: write KEY=VALUE{known}{how} ({why})"


def _of_group(key: str, value: str, tree: Mapping[str, Any]) -> str | None:
    """That a key is a group of values, None where it is none."""
    group: Any = tree
    for name in key.lstrip("+").split("."):
        group = group.get(name) if isinstance(group, Mapping) else None
    if not isinstance(group, Mapping) or not group:
        return None
    names = ", ".join(f"{key}.{name}" for name in list(group)[:SHOWN])
    return f"'{key}' is a group of values, not {value}: set one of {names}"


def _choice_message(lines: list[str], folders: Sequence[Path]) -> str | None:
    """Which presets or options there are, None where the error is about something else."""
    absent = re.search(r"Could not find '([^']+)/([^'/]*)'", " ".join(lines))
    if absent is None:
        return None
    group, name = absent.groups()
    if group == "preset":
        names = sorted({path.stem for folder in folders for path in (folder / "preset").glob("*.yaml")})
        there_are = f"use one of {', '.join(names)}" if names else "there are none"
        return f"there is no preset '{name}': {there_are}; --config-dir=DIR adds those of DIR/preset"
    names = [line.strip() for line in lines[1:] if re.fullmatch(r"\s+[\w\-]+", line)]
    return f"there is no {group}={name}" + (f": use one of {', '.join(names)}" if names else "")


def _file_message(lines: list[str], folders: Sequence[Path]) -> str | None:
    """What Hydra says of a file of values, with its place; None where it says nothing of one."""
    said = re.search(r"\b[Ii]n '([^']+)'[:,]? ?(.*)", " ".join(lines[:2]))
    files = [folder / f"{said[1]}.yaml" for folder in folders] if said else []
    file = next((file for file in files if file.is_file()), None)
    if not said or not file:
        return None
    at = next(filter(None, (presets.place(file, key) for key in ("defaults", "hydra"))), str(file))
    problem = re.split(r"Config search path|Available options", said[2])[0].strip(" .:")
    return f"{at}: {problem}; a file of values needs neither 'defaults' nor 'hydra'"
