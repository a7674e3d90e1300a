"""What `--help` and `--cfg job` print of an experiment."""

import contextlib
import io
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from urbanjax.io.runs import presets

WIDTH = 120
LONGEST = 60  # letters of a default
HELP = """{about}

  {program} [preset=NAME] [KEY=VALUE ...]

Presets, files of {folder}; --config-dir=DIR adds those of DIR/preset:
{presets}

How to change what is done:
  KEY=VALUE           sets a value, KEY.KEY=VALUE one of a group; quote lists: 'KEY=[1,2]'
  -m KEY=VALUE,VALUE  runs once with each of the values, and with every combination of several keys
  --cfg job           shows all values with the ones given, and runs nothing
  hydra.run.dir=DIR   writes to DIR instead of outputs/{name}/<date>_<time>

Values, with what they are if nothing is said:
{values}

Groups of values (--cfg job shows them, '--cfg job --package GROUP' one of them):
  {groups}
"""


def help_text(name: str, tree: Mapping[str, Any], *, folder: Path, about: str) -> str:
    """What `--help` says, as a template of Hydra.

    Args: name of the experiment; tree, its nested defaults; folder of the folder of its presets; about, what it is.
    """
    files = sorted((folder / "preset").glob("*.yaml"))
    chosen = {f"preset={path.stem}": presets.about(path) for path in files}
    values = {key: _short(value) for key, value in tree.items() if not isinstance(value, Mapping)}
    text = HELP.format(
        name=name,
        about=about.strip(),
        program=program(name),
        folder=f"configs/{name}/preset",
        presets=_columns(chosen) if chosen else "  none yet",
        values=_columns(values) if values else "  none but those of groups",
        groups=", ".join(key for key, value in tree.items() if isinstance(value, Mapping)) or "none",
    )
    return text.rstrip().replace("$", "$$")


def program(name: str) -> str:
    """The command that runs this program. Args: name of the experiment."""
    module = getattr(getattr(sys.modules["__main__"], "__spec__", None), "name", None) or f"experiments.{name}"
    return f"python -m {module.removesuffix('.__main__')}"


@contextlib.contextmanager
def readable(name: str, package: str | None) -> Iterator[None]:
    """Within it what is printed is YAML, which comes out so that it can be read, and kept as a preset.

    Values stand before groups, and lists in a line. Args: name of the experiment; package, the one group that is shown.
    """
    import yaml

    text = io.StringIO()
    try:
        with contextlib.redirect_stdout(text):
            yield
    finally:
        said = text.getvalue()
        try:
            values = yaml.safe_load(said)
        except yaml.YAMLError:
            values = None
        if isinstance(values, dict):
            where = package or "_global_"
            print(
                f"# @package {where}\n# Values of '{program(name)}'; a file configs/{name}/preset/NAME.yaml of some of"
            )
            print("# them, with this first line, is taken with preset=NAME. Lengths in m, times in s, angles in rad.")
            said = yaml.dump(_values_first(values), Dumper=_dumper(), sort_keys=False, width=WIDTH, allow_unicode=True)
        print(said, end="")


def _values_first(values: dict[str, Any]) -> dict[str, Any]:
    return dict(sorted(values.items(), key=lambda item: isinstance(item[1], dict)))


def _dumper() -> Any:
    import yaml

    class InLines(yaml.SafeDumper):
        """YAML with lists in a line."""

    InLines.add_representer(list, lambda dumper, items: dumper.represent_sequence(SEQUENCE, items, flow_style=True))
    return InLines


SEQUENCE = "tag:yaml.org,2002:seq"


def _short(value: Any) -> str:
    text = str(value).replace("'", "") if value != "" else "(none)"
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 4]} ..."


def _columns(rows: Mapping[str, str]) -> str:
    width = max(map(len, rows))
    return "\n".join(f"  {name.ljust(width)}  {text}".rstrip() for name, text in rows.items())
