"""What a waiting user sees: a bar that moves, and the table at the end."""

import contextlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Protocol

from urbanjax.io.runs.report import cell


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
    """Print the table.

    Args: title above it; columns by heading; texts, headings of columns besides the first that stand left.
    """
    from rich import box
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    shown = Table(title=escape(title), title_justify="left", box=box.SIMPLE, padding=(0, 1, 0, 0))
    for i, name in enumerate(columns):
        shown.add_column(escape(name), justify="left" if i == 0 or name in texts else "right", no_wrap=i == 0)
    for row in zip(*columns.values(), strict=True):
        shown.add_row(*(escape(cell(value)) for value in row))
    Console().print(shown)
