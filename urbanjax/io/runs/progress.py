"""What a waiting user sees: a bar that moves, and the table at the end."""

import contextlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Protocol

from urbanjax.io.runs.report import cell

WIDEST = 10_000  # letters of a line, of which no terminal has that many


class Tick(Protocol):
    """Told what is being done and the share that is done (None: not known)."""

    def __call__(self, label: str, share: float | None = None) -> None:
        """Show it."""


@contextlib.contextmanager
def bar(title: str) -> Iterator[Tick]:
    """A progress bar; call it with what is being done and the share that is done (None: not known).

    Args: title beside the bar.
    """
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        TextColumn("{task.fields[title]}"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, transient=False) as display:
        task = display.add_task("", total=None, title=title)

        def tick(label: str, share: float | None = None) -> None:
            display.update(task, description=label, total=None if share is None else 1.0, completed=share or 0.0)

        yield tick
        display.update(task, description="done", total=1.0, completed=1.0)


def show_table(title: str, columns: Mapping[str, Sequence[Any]], *, texts: Collection[str] = ()) -> None:
    """Print the table, lying on its side where it is too wide and has fewer rows than columns.

    Args: title above it; columns by heading; texts, headings of columns besides the first that stand left.
    """
    from rich.console import Console

    console = Console()
    rows = list(zip(*columns.values(), strict=True))
    shown = _table(title, list(columns), rows=rows, texts=texts)
    if (
        len(rows) < len(columns)
        and console.measure(shown, options=console.options.update(max_width=WIDEST)).maximum > console.width
    ):
        first, *others = zip(columns, *rows, strict=True)
        shown = _table(title, list(map(str, first)), rows=others)
    console.print(shown)


def _table(title: str, names: Sequence[str], *, rows: Sequence[Sequence[Any]], texts: Collection[str] = ()) -> Any:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    shown = Table(title=escape(title), title_justify="left", box=box.SIMPLE, padding=(0, 1, 0, 0))
    for i, name in enumerate(names):
        shown.add_column(escape(name), justify="left" if i == 0 or name in texts else "right", no_wrap=i == 0)
    for row in rows:
        shown.add_row(*(escape(cell(value)) for value in row))
    return shown
