"""Pictures and pages: what is written can be read back, and a report needs nothing beside it."""

import re

import numpy as np
import pytest
from PIL import Image

from urbanjax.io.figures import animation
from urbanjax.io.figures import style as figures
from urbanjax.io.runs import directory as runs
from urbanjax.io.runs import report


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "line.png"
    with figures.figure(path, 4.0, height=3.0) as canvas:
        canvas.subplots().plot([0, 1], [0, 1])
    return path


def test_a_figure_is_drawn_at_its_size(picture):
    with Image.open(picture) as image:
        assert image.size == (600, 450)
        assert np.asarray(image.convert("L")).std() > 1.0


def test_drawing_leaves_the_style_of_others_alone(picture):
    import matplotlib

    assert matplotlib.rcParams["axes.spines.top"]


def test_a_gif_plays_its_frames_in_order(tmp_path):
    frames = [np.full((20, 30, 3), (40 * k, 0, 200), np.uint8) for k in range(5)]
    animation.write_gif(tmp_path / "a.gif", frames, rate=10.0)
    with Image.open(tmp_path / "a.gif") as image:
        assert image.n_frames == 5
        assert image.info["duration"] == 100
        assert image.info["loop"] == 0
        for k in range(5):
            image.seek(k)
            assert np.abs(np.asarray(image.convert("RGB"), int)[5, 5] - [40 * k, 0, 200]).max() < 12
    with pytest.raises(ValueError, match="no frames"):
        animation.write_gif(tmp_path / "b.gif", [], rate=10.0)


def test_stacked_pictures_carry_their_labels():
    rows = [np.zeros((40, 200, 3), np.uint8)] * 2
    both = animation.stacked(rows, ["tau 0", "tau 1"])
    assert both.shape == (80, 200, 3)
    assert both[:20, :50].max() == 255
    assert both[30:40].max() == 0


def test_a_report_is_self_contained_and_escapes_what_it_shows(tmp_path, picture):
    animation.write_gif(tmp_path / "a.gif", [np.zeros((4, 4, 3), np.uint8)] * 2, rate=5.0)
    table = report.Table("speeds", {"tau": [0.25, None], "hit <b>": [True, np.float32(np.nan)]})
    items = [table, report.Picture("a line", picture), report.Picture("moving", tmp_path / "a.gif")]
    sections = [report.Section("First & last", ["x < y"], items)]
    manifest = runs.Run(tmp_path / "run", {"name": "</pre><script>"}).manifest()
    page = tmp_path / "report.html"
    report.write_report(page, "Study", sections=sections, manifest=manifest)
    text = page.read_text()
    assert "First &amp; last" in text
    assert "x &lt; y" in text
    assert "<script" not in text
    assert "<td>0.25</td><td>yes</td>" in text
    assert "<td>-</td><td>-</td>" in text
    sources = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert len(sources) == 2
    assert sources[0].startswith("data:image/png;base64,")
    assert sources[1].startswith("data:image/gif;base64,")
    assert not re.search(r"https?://|<link|@import|url\(", text)
    assert re.findall(r"img \{[^}]*\}", text) == ["img { max-width: 100%; height: auto; border: 1px solid #eee; }"]


def test_a_page_may_say_of_a_run_what_its_manifest_does_not(tmp_path):
    manifest = runs.Run(tmp_path / "run", {}).manifest()
    page = tmp_path / "report.html"
    report.write_report(page, "Study", sections=[], manifest=manifest)
    assert "<td>git commit</td>" in page.read_text()
    facts = lambda told: {"written": told["started"]}  # noqa: E731
    report.write_report(page, "Study", sections=[], manifest=manifest, facts=facts)
    assert f'<td>written</td><td class="words fact">{manifest["started"]}</td>' in page.read_text()
    assert "<td>git commit</td>" not in page.read_text()
