"""Texts beside the code stand by themselves: none begins with a preposition that leans on a name."""

import re

from tests.test_house import ROOMS, others, sources

_WORDS = r"(?:As|After|At|By|For|From|In|Of|On|To|With|Until)\b.*"
_DOCSTRING = re.compile(rf'^\s*r?"""\s*{_WORDS}', re.MULTILINE)
"""The beginning of a docstring of a module, class, function, constant or field."""
_C_COMMENT = re.compile(rf"^/\*+\s*{_WORDS}", re.MULTILINE)
"""The beginning of a comment that opens a file, or a function, in C."""


def test_no_docstring_and_no_c_comment_begins_with_a_preposition():
    for paths, pattern in ((sources(*ROOMS, "benchmarks"), _DOCSTRING), (others(".c", ".h"), _C_COMMENT)):
        texts = {str(path): path.read_text(encoding="utf-8") for path in paths}
        assert sum('"""' in text or "/*" in text for text in texts.values()) > 50
        assert {name: found for name, text in texts.items() if (found := pattern.findall(text))} == {}


def test_a_fragment_is_seen():
    seen = 'ROOM: Final = 2\n"""In frames."""\n\ndef kept(self):\n    """\n    Until a reset."""\n'
    assert len(_DOCSTRING.findall(seen)) == 2
    assert _DOCSTRING.findall('x = """"In"""\n"""Inches, a room of frames."""\n') == []
    assert _C_COMMENT.findall("/* For one frame. */\nint sw_sent(void) { /* To the bus. */") == ["/* For one frame. */"]
