"""What the site makes of the files: its order, moved links, signatures, docstrings."""

from docs.site import api, pages, source
from docs.site.navigation import Group, sections

LIST = """# Documents

| you are | begin with |
|---|---|
| a reader | [a table is no list](how-to/table.md) |

## Tutorial

- [One](tutorial/one.md): words

## How to

### First things

- [Two](how-to/two.md), and [three](how-to/three.md#part)

## Words

No list.
"""

MODULE = '''"""Frames."""
from contract.arrays import Array
LIMIT: Final = 3
"""Of frames."""
OTHER = 4
@dataclass(frozen=True, kw_only=True)
class Frame:
    data: bytes
    of: Annotated[Array | None, "unit"] = None
    _hidden: int = 0
    @property
    def length(self) -> int: ...
    @classmethod
    def empty(cls) -> "Frame": ...
    def __len__(self): ...
def send(frame: Frame, times: int = LIMIT) -> None:
    """Send it."""
def _private(): ...
'''


def test_sections_and_groups_come_in_the_order_of_the_list():
    tutorial, how_to = sections(LIST)
    assert (tutorial.name, tutorial.groups[0].pages) == ("Tutorial", ("tutorial/one.md",))
    text = "- [Two](how-to/two.md), and [three](how-to/three.md#part)"
    assert how_to.groups == (Group(name="First things", text=text, pages=("how-to/two.md", "how-to/three.md")),)


def test_a_moved_text_leads_to_the_same_files():
    source, target = pages.ROOT / "examples" / "fleet" / "README.md", pages.GENERATED / "examples-fleet.markdown"
    text = pages.moved("[a](../../docs/x.md#y), [b](run.py), [c](https://a.org/b), [d](#e)", source, target)
    assert text == "[a](../x.md#y), [b](../../examples/fleet/run.py), [c](https://a.org/b), [d](#e)"


def test_every_public_module_is_on_one_page():
    public = {
        ".".join(path.relative_to(pages.ROOT).with_suffix("").parts)
        for package in source.PACKAGES
        for path in (pages.ROOT / package).rglob("*.py")
        if not path.name.startswith("_") and (path.parent / "__init__.py").exists()
    }
    shown = [f"{folder}.{name}" for folder, names in api.folders() for name in names]
    assert sorted(shown) == sorted(public)


def test_a_module_s_public_names_come_with_signatures_and_docstrings(tmp_path):
    (tmp_path / "a.py").write_text(MODULE)
    found = source.read(tmp_path / "a.py", "wake.a")
    limit, frame, send = found.members
    assert (limit.kind, limit.options, limit.docstring) == ("data", (":value: 3",), "Of frames.")
    assert (frame.kind, frame.signature) == ("class", "(*, data: bytes, of: ~contract.arrays.Array | None = None)")
    assert [(one.kind, one.name, one.options) for one in frame.members] == [
        ("property", "length", (":type: int",)),
        ("method", "empty", (":classmethod:",)),
    ]
    assert api.restructured(["Where |Cd| is:", "", "    a | b"]) == ["Where \\|Cd\\| is:", "", "::", "", "    a | b"]
    assert (send.signature, send.docstring) == ("(frame: ~wake.a.Frame, times: int=LIMIT) -> None", "Send it.")
