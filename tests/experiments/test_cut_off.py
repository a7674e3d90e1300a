"""An evaluation that is killed and gone on with comes to what an undisturbed one comes to, on any number of devices."""

import time

import pytest

from tests.experiments.commands import evaluate, tables

DRIVES = ("seeds=72", "logs=true")  # five chunks, the last one not full
LIMIT = 600.0  # s


@pytest.mark.slow
def test_a_killed_evaluation_goes_on_to_the_same_tables(tmp_path):
    whole = evaluate(tmp_path / "whole", *DRIVES)
    said = whole.communicate(timeout=LIMIT)[0]
    assert whole.returncode == 0, said

    cut = evaluate(tmp_path / "cut", *DRIVES)
    rows, began = tmp_path / "cut" / "rows", time.monotonic()
    while not list(rows.glob("*.parquet")) and time.monotonic() - began < LIMIT:
        time.sleep(0.01)
    cut.kill()
    cut.communicate()
    done = len(list(rows.glob("*.parquet")))
    assert 1 <= done < 5
    assert not (tmp_path / "cut" / "rows.csv").exists()

    rest = evaluate(tmp_path / "rest", *DRIVES, f"resume={tmp_path / 'cut'}", devices=8)
    said = rest.communicate(timeout=LIMIT)[0]
    assert rest.returncode == 0, said
    assert tables(tmp_path / "rest") == tables(tmp_path / "whole")
    assert len(tables(tmp_path / "rest")) == 11
