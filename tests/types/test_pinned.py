"""Which keys a pattern means."""

import pytest

from urbanjax.types.pinned import fits


@pytest.mark.parametrize(
    ("pattern", "key", "means"),
    [
        ("a.b", "a.b", True),
        ("a", "a.b", True),
        ("a.*", "a.b.c", True),
        ("*_scale", "a.gap_scale", True),
        ("a.b[3]", "a.b[3]", True),
        ("a.b", "a.b[3]", True),
        ("a.?", "a.b[3]", True),
        ("a", "a[0].b", True),
        ("a.b", "a.bc", False),
        ("a.b[3]", "a.b3", False),
        ("a.b[3]", "a.b[30]", False),
        ("a.b", "axb", False),
        ("b", "a.b", False),
        ("", "a", False),
    ],
)
def test_a_pattern_means_a_key_its_tuple_or_its_group(pattern, key, means):
    assert fits(key, pattern) is means
