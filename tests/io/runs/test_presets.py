"""Whatever is wrong in a file of values is said in one line: file, line, column and remedy."""

import pytest

HEAD = "# @package _global_\n"
PLACED = {  # what the file holds, where in it something is wrong, and what is said of it
    "indented": (
        f"{HEAD}vehicle:\n  length: 3\n width: 2\n",
        (4, 2),
        "begin all lines of one group in the same column",
    ),
    "tab": (f"{HEAD}vehicle:\n\tlength: 3\n", (3, 1), "indent with spaces"),
    "twice": (f"{HEAD}vehicle:\n  length: 3\n  length: 4\n", (4, 3), "'length' stands in line 3 already; keep one of"),
    "list": (f"{HEAD}- seed\n", (2, 1), "the file is a list; write lines of KEY: VALUE"),
    "text": (f"{HEAD}seed\n", (2, 1), "the file is a single value; write lines"),
    "bytes": (HEAD.encode() + "# é".encode() + b"\xff\n", (2, 4), "this is not UTF-8; save the file as UTF-8"),
    "control": (f"{HEAD}seed: \x07\n", (2, 7), "remove this character"),
    "empty": ("", (1, 1), "the file holds no values"),
    "comments": (f"{HEAD}# nothing\n", (1, 1), "the file holds no values"),
    "headless": ("seed: 1\n", (1, 1), "begin it with '# @package _global_'"),
    "colon": (f"{HEAD}folder: a: b\n", (2, 10), "quote a text that holds ': '"),
    "quote": (f"{HEAD}folder: 'a\n", (3, 1), "close what is open: a quote"),
    "code": (f"{HEAD}folder: !!python/object/apply:os.system [x]\n", (2, 9), "leave out the tag"),
    "alias": (f"{HEAD}folder: *a\n", (2, 9), "write the value itself"),
    "brace": (f"{HEAD}folder: '${{oc.env:'\n", (2, 9), "write ${KEY}"),
    "nope": (f"{HEAD}seed: ${{nope}}\n", (2, 1), "'seed': Interpolation key 'nope' not found; name another key"),
    "unset": (f"{HEAD}vehicle:\n  length: ${{oc.env:NOT_SET}}\n", (3, 3), "the environment has no NOT_SET; set it, or"),
    "resolver": (f"{HEAD}seed: ${{nothing:1}}\n", (2, 1), "Unsupported interpolation type nothing; name"),
    "circle": (f"{HEAD}seed: ${{seed}}\n", (2, 1), "Recursive interpolation"),
    "element": (f"{HEAD}grid: [0.0, x]\n", (2, 13), "'grid[1]' must be a finite number, not 'x'"),
    "group": (f"{HEAD}vehicle: 3\n", (2, 1), "'vehicle' is a group of values, not 3"),
    "unread": (f"{HEAD}vehicle: {{max_speed: 3}}\n", (2, 11), "'vehicle.max_speed' is read by nothing here"),
    "unknown": (f"{HEAD}vehicle:\n  lenght: 3\n", (3, 3), "unknown key 'vehicle.lenght'"),
    "defaults": (f"{HEAD}defaults: [other]\nseed: 1\n", (2, 1), "needs neither 'defaults' nor 'hydra'"),
    "hydra": (f"{HEAD}hydra: 3\n", (2, 1), "needs neither 'defaults' nor 'hydra'"),
}


@pytest.mark.parametrize("name", PLACED)
def test_a_broken_file_is_named_with_the_place_and_the_remedy(home, run, name):
    text, (line, column), message = PLACED[name]
    folder = home / "mine" / "preset"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
    done = run("--config-dir=mine", f"preset={name}")
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert f"mine/preset/{name}.yaml, line {line}, column {column}" in done.stderr
    assert message in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--config-dir", "nowhere"], "nowhere' not found"),
        (["--config-name=other"], "--config-name is refused: "),
        (["--config-path=other"], "--config-path is refused: "),
        (["--experimental-rerun", "x.pickle"], "--experimental-rerun is refused: it runs whatever its file says; put"),
        (["hydra/launcher=zzz"], "there is no hydra/launcher=zzz: use one of basic"),
        (["hydra.job.nope=1"], "unknown key 'hydra.job.nope' on the command line; --cfg hydra shows those"),
        (["hydra.run.dir=${nope}"], "'hydra.run.dir': Interpolation key 'nope' not found; name"),
        (["hydra.run.dir=/proc/x"], "/proc/x: No such file or directory; name another folder with hydra.run.dir=DIR"),
        (["seed=${oc.env:NOT_SET}"], "'seed': the environment has no NOT_SET; set it, or give a default"),
        (["preset=fast,short"], "preset=fast,short gives several values: add -m to run with each, or write the list"),
        (["preset="], "there is no preset '': use one of "),
        (["+preset=fast"], "Multiple values for preset"),
        (["nope@x=1"], "config group 'nope' does not exist"),
        (["--nope"], "unrecognized arguments: --nope; --help says what there is"),
        (["--cfg", "x"], "invalid choice: 'x'"),
        (["--resolve"], "--resolve flag can only be used in conjunction with"),
        (["-m", "--cfg", "job"], "Only one of --run, --multirun, --cfg"),
        (["-sc", "install=fox"], "No completion plugin for 'fox' found"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_wrong_option_is_one_line(run, arguments, message):
    done = run(*arguments)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert message in done.stderr
