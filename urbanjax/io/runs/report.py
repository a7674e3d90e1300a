"""One self-contained page of a run: tables, figures and moving pictures inside it."""

import base64
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from urbanjax.io.runs.directory import write_atomically
from urbanjax.types import host_record

KINDS = {".png": "image/png", ".gif": "image/gif"}


@host_record
class Table:
    """Columns by heading, with a caption."""

    caption: str
    columns: Mapping[str, Sequence[Any]]

    @property
    def rows(self) -> list[list[str]]:
        """The cells as text, row by row."""
        return [[cell(value) for value in row] for row in zip(*self.columns.values(), strict=True)]

    @property
    def marks(self) -> list[str]:
        """What the cells of each column are marked with: words begin at the left, as the first column does."""
        from markupsafe import Markup

        words = [number > 0 and any(map(_is_words, values)) for number, values in enumerate(self.columns.values())]
        return [Markup(' class="words"') if there else "" for there in words]


@host_record
class Picture:
    """A PNG or GIF file, with a caption."""

    caption: str
    path: Path

    @property
    def source(self) -> str:
        """The file as a data address."""
        content = base64.b64encode(self.path.read_bytes()).decode()
        return f"data:{KINDS[self.path.suffix]};base64,{content}"


@host_record
class Section:
    """A heading, paragraphs, and tables, pictures and more paragraphs in their order."""

    title: str
    text: Sequence[str] = ()
    items: Sequence[Table | Picture | str] = ()


def cell(value: Any) -> str:
    """A value as a reader wants it: few digits, a dash for nothing.

    Args: value of any kind.
    """
    value = value.item() if hasattr(value, "item") else value
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return str(value)


def _is_words(value: Any) -> bool:
    """Whether a cell is a text that does not begin with a number, as one with its interval does."""
    return isinstance(value, str) and value != "-" and not value.lstrip("+-~<> ")[:1].isdigit()


def write_report(
    path: Path,
    title: str,
    *,
    sections: Sequence[Section],
    manifest: Mapping[str, Any],
    facts: Callable[[Mapping[str, str]], Mapping[str, str]] = dict,
) -> None:
    """Write the page, whole or not at all; everything that it shows is inside the file.

    Args: path of the page; title, its heading; sections in their order; manifest of the run; facts, from what the
    manifest says of the run, by name, to what the page says of it.
    """
    import jinja2

    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.tests["table"] = lambda item: isinstance(item, Table)
    environment.tests["paragraph"] = lambda item: isinstance(item, str)
    page = environment.from_string(PAGE).render(
        title=title, sections=sections, facts=facts(_facts(manifest)), config=json.dumps(manifest["config"], indent=2)
    )
    write_atomically(path, page)


def _facts(manifest: Mapping[str, Any]) -> dict[str, str]:
    versions = ", ".join(f"{name} {version}" for name, version in manifest["versions"].items() if version)
    commit = manifest["git"]["commit"]
    device = manifest["device"]
    return {
        "command": manifest["command"],
        "started": manifest["started"],
        "wall time": f"{manifest['wall_time_s']:.0f} s",
        "seed": str(manifest["seed"]),
        "git commit": f"{commit[:12]}{' with changes' if manifest['git']['dirty'] else ''}"
        if commit
        else "not under git",
        "versions": versions,
        "device": f"{device['kind']} ({device['cpu']})",
        "config": f"sha256 {manifest['config_sha256'][:12]}",
    }


PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ title }}</title>
<style>
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1000px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: .3rem; }
h2 { font-size: 1.2rem; margin-top: 2.2rem; border-bottom: 1px solid #ddd; padding-bottom: .2rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; margin: .8rem 0; font-variant-numeric: tabular-nums; font-size: .9rem; }
caption, figcaption { text-align: left; color: #555; font-size: .85rem; padding-bottom: .3rem; }
th, td { padding: .25rem .7rem; border-bottom: 1px solid #eee; text-align: right; }
th:first-child, td:first-child, .words { text-align: left; }
td:not(.words):not(:first-child) { white-space: nowrap; }
td.words { min-width: 5rem; max-width: 32rem; }
thead th { border-bottom: 1px solid #999; font-weight: 600; }
figure { margin: 1rem 0; }
img { max-width: 100%; height: auto; border: 1px solid #eee; }
p, caption, figcaption, td.fact { overflow-wrap: anywhere; }
@media (max-width: 640px) { body { margin: 1rem auto; padding: 0 .7rem; } }
pre { background: #f7f7f7; padding: .8rem; overflow-x: auto; font-size: .8rem; }
</style>
</head>
<body>
<h1>{{ title }}</h1>
{% for section in sections %}
<h2>{{ section.title }}</h2>
{% for paragraph in section.text %}
<p>{{ paragraph }}</p>
{% endfor %}
{% for item in section["items"] %}
{% if item is table %}
{% set marks = item.marks %}
<div class="scroll"><table><caption>{{ item.caption }}</caption>
<thead><tr>{% for name in item.columns %}<th{{ marks[loop.index0] }}>{{ name }}</th>{% endfor %}</tr></thead>
<tbody>
{% for row in item.rows %}
<tr>{% for text in row %}<td{{ marks[loop.index0] }}>{{ text }}</td>{% endfor %}</tr>
{% endfor %}
</tbody></table></div>
{% elif item is paragraph %}
<p>{{ item }}</p>
{% else %}
<figure><img alt="{{ item.caption }}" src="{{ item.source }}"><figcaption>{{ item.caption }}</figcaption></figure>
{% endif %}
{% endfor %}
{% endfor %}
<h2>This run</h2>
<div class="scroll"><table>
{% for name, value in facts.items() %}
<tr><td>{{ name }}</td><td class="words fact">{{ value }}</td></tr>
{% endfor %}
</table></div>
<details><summary>Configuration</summary><pre>{{ config }}</pre></details>
</body>
</html>
"""
