"""What `help()` says of a record: its docstring, and each field with the comment that stands beside it."""

import ast
import inspect
import io
import textwrap
import tokenize
from typing import Any


class FieldsDoc:
    """A `__doc__` that reads the source of its class when it is asked for, not when the class is made."""

    def __init__(self, text: str | None):
        """Args: text, the docstring of the class."""
        self.text, self.full = text, {}

    def __get__(self, instance: Any, owner: type) -> str | None:
        """The docstring with a section on the fields, where the source is at hand."""
        if owner not in self.full:
            self.full[owner] = _with_fields(self.text, owner)
        return self.full[owner]


def _with_fields(text: str | None, owner: type) -> str | None:
    try:
        source = textwrap.dedent(inspect.getsource(owner))
        fields = _fields(source)
    except (OSError, TypeError, SyntaxError):  # made by hand, or shipped without its source
        return text
    if not fields:
        return text
    lines = "\n".join(textwrap.fill(line, 116, initial_indent="    ", subsequent_indent=8 * " ") for line in fields)
    return f"{inspect.cleandoc(text or '')}\n\nFields:\n{lines}\n"


def _fields(source: str) -> list[str]:
    """One line for each annotated field of the class: name (kind = default): comment."""
    comments = _comments(source)
    whole = {number for number, line in enumerate(source.splitlines(), 1) if line.lstrip().startswith("#")}
    body = ast.parse(source).body[0]
    assert isinstance(body, ast.ClassDef)
    lines = []
    for spec in body.body:
        if not isinstance(spec, ast.AnnAssign) or not isinstance(spec.target, ast.Name):
            continue
        kind = ast.unparse(spec.annotation)
        if kind.startswith("ClassVar"):
            continue
        above = []
        number = spec.lineno - 1
        while number in whole:
            above.insert(0, comments[number])
            number -= 1
        beside = comments.get(spec.end_lineno or spec.lineno, "")
        said = "; ".join(part for part in (" ".join(above), beside) if part)
        lines.append(f"{spec.target.id} ({kind}{_default(spec.value)})" + (f": {said}" if said else ""))
    return lines


def _default(value: ast.expr | None) -> str:
    if isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and value.func.id in ("field", "static"):
        value = next((word.value for word in value.keywords if word.arg == "default"), None)
    return "" if value is None else f" = {ast.unparse(value)}"


def _comments(source: str) -> dict[int, str]:
    """Comments by line."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {token.start[0]: token.string.lstrip("# ").strip() for token in tokens if token.type == tokenize.COMMENT}
