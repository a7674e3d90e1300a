"""What is printed while and after a run."""

from urbanjax.io.runs import progress


def test_a_table_that_is_too_wide_lies_on_its_side(capsys, monkeypatch):
    columns = {f"measure number {i}": [f"{i}.5 [{i}.25, {i}.75]"] for i in range(9)}
    for width, lines in (("400", 1), ("80", 9)):
        monkeypatch.setenv("COLUMNS", width)
        progress.show_table("measures", columns)
        said = capsys.readouterr().out
        assert "…" not in said
        assert sum(".25, " in line for line in said.splitlines()) == lines
        assert all(name in said for name in columns)
