"""What a file of somebody else's says is shown, on a terminal and in Markdown, and does nothing there."""

import pytest

from sb3_bruno.files.markdown import as_code, as_text
from sb3_bruno.files.shown import printable, shown

HOSTILE = "\x1b]0;owned\x07\n\u202e\ud800"


@pytest.mark.parametrize("value", [HOSTILE, HOSTILE * 100_000, [HOSTILE] * 100_000, {HOSTILE: [HOSTILE]}, 10**4_000])
def test_a_value_is_shown_on_one_short_line(value):
    assert shown(value).isprintable() and len(shown(value)) < 70


def test_a_value_that_is_nested_deep_is_shown():
    nested = []
    for _ in range(5_000):
        nested = [nested]
    assert len(shown(nested)) < 70


def test_a_short_value_is_shown_as_python_writes_it():
    assert [shown(value) for value in ("PointDir-v0", [1, 2.5], None, True)] == [
        "'PointDir-v0'",
        "[1, 2.5]",
        "None",
        "True",
    ]


def test_a_message_keeps_what_can_be_printed():
    assert printable("Größe: 3 µm \x1b[31m\n") == "Größe: 3 µm \\x1b[31m\\n"


@pytest.mark.parametrize(
    ("said", "written"),
    [
        ("a|b", r"a\|b"),
        ("<img src=x onerror=alert(1)>", "&lt;img src=x onerror=alert(1)&gt;"),
        ("&lt;", "&amp;lt;"),
        ("[x](javascript:alert(1))", r"[x\](javascript:alert(1))"),
        ("[x][y]: z", r"[x\][y\]: z"),
        ("`code` **bold** ~~gone~~", r"\`code\` \*\*bold\*\* \~\~gone\~\~"),
        (r"\|", r"\\\|"),
        ("two\n\n# lines", "two # lines"),
        ("tasks=[[0.0, 1.0]], x_y", "tasks=[[0.0, 1.0]], x_y"),
        ("\x1b[31m", r"\\x1b[31m"),
    ],
)
def test_markdown_makes_nothing_of_what_is_said(said, written):
    assert as_text(said) == written


def test_no_text_ends_its_block_of_code():
    assert as_code("a\nb", "text") == "```text\na\nb\n```"
    assert as_code("x ```\n# Heading\n````", "bash") == "`````bash\nx ```\n# Heading\n````\n`````"
