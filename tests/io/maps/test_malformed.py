"""Maps that are broken at random: each is read, or refused by an error that names the file."""

import random
import re

import numpy as np
import pytest

from tests.io.maps import texts
from urbanjax.io import maps
from urbanjax.io.maps import validity, xml
from urbanjax.types import FileError

MAPS = {"commonroad": texts.COMMONROAD, "lanelet2": texts.lanelet2(), "degrees": texts.lanelet2(local=False)}
MAPS |= {"sumo": texts.SUMO}
VALUES = ["", "nan", "inf", "-1", "0", "1e7", "1e308", "9" * 30, "٣", "abc", "1_0", "in_0", "1", "44", "<", "true"]
BOMB = '<!DOCTYPE a [<!ENTITY b "bbbbbbbbbb"><!ENTITY c "&b;&b;&b;&b;&b;&b;">]>'


def mutated(text, dice):
    """The text with one to three faults, as bytes."""
    for _ in range(dice.randint(1, 3)):
        lines = text.split("\n")
        i = dice.randrange(len(lines))
        number = dice.choice(list(re.finditer(r"[-\d.]+", text)) or [re.match("", text)])
        named = dice.choice(list(re.finditer(r' \w+="([^"]*)"', text)) or [re.match("()", text)])
        match dice.randrange(9):
            case 0:
                text = "\n".join(lines[:i] + lines[i + 1 :])
            case 1:
                text = "\n".join(lines[: i + 1] + lines[i:])
            case 2:
                text = text[: number.start()] + dice.choice(VALUES) + text[number.end() :]
            case 3:
                text = text[: named.start()] + text[named.end() :]
            case 4:
                text = text[: named.start(1)] + dice.choice(VALUES) + text[named.end(1) :]
            case 5:
                j = dice.randrange(len(lines))
                lines[i], lines[j] = lines[j], lines[i]
                text = "\n".join(lines)
            case 6:  # every mention of one number becomes another: links to itself, circles, equal ids
                other = dice.choice(re.findall(r"\b\d+\b", text) or ["1"])
                text = re.sub(rf"\b{re.escape(number.group())}\b", other, text)
            case 7 if dice.random() < 0.2:
                text = text[: dice.randrange(len(text) + 1)]
            case 8 if dice.random() < 0.2:
                return dice.choice([text.encode("utf-16"), BOMB.encode() + text.encode(), text.encode()[::-1], b""])
    return text.encode()


@pytest.mark.filterwarnings("ignore::urbanjax.io.maps.DanglingWarning")
@pytest.mark.parametrize("form", MAPS)
def test_a_broken_map_is_read_or_refused_by_name(tmp_path, form):
    dice, path = random.Random(f"broken {form}"), tmp_path / "broken.xml"
    outcomes = [outcome(path, mutated(MAPS[form], dice)) for _ in range(100)]
    errors = [error for error in outcomes if error is not None]
    assert all(error.startswith(f"{path}: ") for error in errors)
    assert 10 < len(errors) < 90


def outcome(path, data):
    """The error about a map, or None where it was read and everything in it is finite."""
    path.write_bytes(data)
    try:
        found = maps.read(path)
    except maps.MapError as error:
        return str(error)
    for name in ("centre", "left", "right", "heading", "curvature", "length", "left_station", "stop_line"):
        assert np.isfinite(np.asarray(getattr(found.graph, name))).all()
    assert validity.report(found).text()
    return None


def nested(depth):
    return (
        '<commonRoad commonRoadVersion="2020a" timeStepSize="0.1">' + "<a>" * depth + "</a>" * depth + "</commonRoad>"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "no well-formed XML"),
        (b"not xml", "no well-formed XML"),
        (b"<net/>", "holds no lane"),
        (b"<html/>", "<html>: no map"),
        (b"<OpenDRIVE/>", "OpenDRIVE is not read: convert it"),
        (b"{}", "a map is a CommonRoad, Lanelet2 or SUMO file, or a track's .csv"),
        (BOMB.encode() + b"<net>&c;</net>", "declares entities or a document type"),
        (b'<?xml version="1.0" encoding="nonsense"?><net/>', "encoding"),
        (b'<?xml version="1.0" encoding="utf-8"?><net a="\xff"/>', "no well-formed XML"),
        (nested(100).encode(), "lies more than 64 elements deep"),
    ],
)
def test_what_is_no_map_is_refused(read, text, message):
    with pytest.raises(maps.MapError, match=message):
        read(text)


def test_the_caps_hold(read, monkeypatch, tmp_path):
    monkeypatch.setattr(xml, "MOST_ELEMENTS", 20)
    with pytest.raises(maps.MapError, match="more than 20 elements"):
        read(texts.SUMO)
    monkeypatch.setattr(xml, "LARGEST_FILE", 100)
    with pytest.raises(maps.MapError, match="bytes are more than the 100"):
        read(texts.SUMO)
    with pytest.raises(FileError, match="there is no such file"):
        maps.read(tmp_path / "absent.xml")
