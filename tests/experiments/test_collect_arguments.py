"""Directories on a command line come through as they are called."""

from experiments.collect.arguments import quoted, to_overrides

NAMES = (
    "a",
    "a b",
    "a,b",
    "tau=1/x",
    "x[1]",
    "{a: b}",
    "\u65e5\u672c",
    "it's",
    'say "a"',
    "a\\",
    "${oc.env:HOME}",
    "null",
)


def test_directories_on_the_command_line_come_through_hydra_as_they_are():
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from omegaconf import OmegaConf

    text = f"dirs=[{','.join(map(quoted, NAMES))}]"
    held = OverridesParser.create().parse_override(text).value()
    assert OmegaConf.to_container(OmegaConf.create({"dirs": held}), resolve=True) == {"dirs": list(NAMES)}


def test_only_directories_become_directories(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tau=1").mkdir()
    typed = ["one", "score=success", "--cfg", "job", "tau=1", "./b=c", "-cd", "configs", "~preset"]
    assert to_overrides(typed) == [
        "score=success", "--cfg", "job", "-cd", "configs", "~preset", 'dirs=["one","tau=1","./b=c"]'
    ]  # fmt: skip
    assert to_overrides(["--help"]) == ["--help"]
