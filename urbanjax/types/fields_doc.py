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


def comments_of(owner: type) -> dict[str, str]:
    """What is said beside and above each field of a class and of those that it adds to, by name.

    Empty where no source is at hand. Args: owner, the class.
    """
    said = {}
    for cls in reversed(owner.__mro__[:-1]):
        said |= {spec.target.id: text for spec, text in _said(cls)}
    return said


def _with_fields(text: str | None, owner: type) -> str | None:
    fields = [_line(*field) for field in _said(owner)]
    if not fields:
        return text
    lines = "\n".join(textwrap.fill(line, 116, initial_indent="    ", subsequent_indent=8 * " ") for line in fields)
    return f"{inspect.cleandoc(text or '')}\n\nFields:\n{lines}\n"


def _line(spec: ast.AnnAssign, said: str) -> str:
    """A field as name (kind = default): comment."""
    return f"{ast.unparse(spec.target)} ({ast.unparse(spec.annotation)}{_default(spec.value)})" + (said and f": {said}")


def _said(owner: type) -> list[tuple[Any, str]]:
    """Each annotated field of the class itself, with the comments above and beside it."""
    try:
        source = textwrap.dedent(inspect.getsource(owner))
        comments = _comments(source)
        body = ast.parse(source).body[0]
    except (OSError, TypeError, SyntaxError):  # made by hand, or shipped without its source
        return []
    whole = {number for number, line in enumerate(source.splitlines(), 1) if line.lstrip().startswith("#")}
    assert isinstance(body, ast.ClassDef)
    found = []
    for spec in body.body:
        if not isinstance(spec, ast.AnnAssign) or not isinstance(spec.target, ast.Name):
            continue
        if ast.unparse(spec.annotation).startswith("ClassVar"):
            continue
        above = []
        number = spec.lineno - 1
        while number in whole:
            above.insert(0, comments[number])
            number -= 1
        beside = comments.get(spec.end_lineno or spec.lineno, "")
        found.append((spec, "; ".join(part for part in (" ".join(above), beside) if part)))
    return found


def _default(value: ast.expr | None) -> str:
    if isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and value.func.id in ("field", "static"):
        value = next((word.value for word in value.keywords if word.arg == "default"), None)
    return "" if value is None else f" = {ast.unparse(value)}"


def _comments(source: str) -> dict[int, str]:
    """Comments by line."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {token.start[0]: token.string.lstrip("# ").strip() for token in tokens if token.type == tokenize.COMMENT}
