"""Where a process of a shared evaluation is killed, the others say so and end, and nothing that was driven is lost."""

import re
import time

import pytest

from tests.experiments.commands import evaluate, tables
from tests.io.runs.test_processes import free_port

DRIVES = ("seeds=72", "logs=true")  # five chunks, the last one not full
LIMIT = 600.0  # s
NOTICE = 30.0  # s from the death of one process to the end of the others


def shared(folder, *arguments):
    """Two processes that evaluate together, begun."""
    keys = ("processes=2", f"coordinator=127.0.0.1:{free_port()}")
    return [
        evaluate(folder.with_name(f"{folder.name}_{k}"), *DRIVES, *keys, f"process={k}", *arguments) for k in (0, 1)
    ]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("evaluation") / "whole"
    alone = evaluate(folder, *DRIVES)
    said = alone.communicate(timeout=LIMIT)[0]
    assert alone.returncode == 0, said
    return tables(folder)


@pytest.mark.slow
@pytest.mark.parametrize("killed", [0, 1])
def test_the_survivor_ends_readably_and_all_go_on_to_the_same_tables(tmp_path, whole, killed):
    pair = shared(tmp_path / "cut")
    rows, began = tmp_path / "cut_0" / "rows", time.monotonic()
    while not list(rows.glob("*.parquet")) and all(one.poll() is None for one in pair):
        assert time.monotonic() - began < LIMIT
        time.sleep(0.01)
    pair[killed].kill()
    began = time.monotonic()
    said = [one.communicate(timeout=LIMIT)[0] for one in pair][1 - killed]
    assert time.monotonic() - began < NOTICE
    assert pair[1 - killed].returncode == 2
    assert "Traceback" not in said
    assert "***" not in said
    assert len(re.findall("error", said, re.IGNORECASE)) == 1
    line = rf"error: process {killed} has ended without a word: what has been computed is kept in (\S+); start all.*=\1"
    kept = re.search(line, said)
    assert kept, said
    done = list(rows.glob("*.parquet"))
    assert 1 <= len(done) < 5
    assert (tmp_path / kept.group(1)).resolve() == rows.parent
    assert not (tmp_path / "cut_1").exists()

    pair = shared(tmp_path / "rest", f"resume={kept.group(1)}")
    said = [one.communicate(timeout=LIMIT)[0] for one in pair]
    assert [one.returncode for one in pair] == [0, 0], said
    assert tables(tmp_path / "rest_0") == whole
    assert len(whole) == 11
