"""Elements of ODX 2.2 as text: parameters, types with named values, structures, services and state charts."""

from collections.abc import Iterable, Mapping
from typing import Final
from xml.sax.saxutils import escape

CODED: Final = (
    '<DIAG-CODED-TYPE BASE-DATA-TYPE="A_UINT32" xsi:type="STANDARD-LENGTH-TYPE">'
    "<BIT-LENGTH>{}</BIT-LENGTH></DIAG-CODED-TYPE>"
)


def named(tag: str, name: str, *parts: str, prefix: str = "") -> str:
    """An element with a short name, whose identifier is that name behind a prefix."""
    return f'<{tag} ID="{prefix}{name}"><SHORT-NAME>{name}</SHORT-NAME>{"".join(parts)}</{tag}>'


def constant(name: str, value: int, bits: int = 8) -> str:
    """A parameter that always has this value."""
    inner = f"<SHORT-NAME>{name}</SHORT-NAME><CODED-VALUE>{value}</CODED-VALUE>{CODED.format(bits)}"
    return f'<PARAM xsi:type="CODED-CONST">{inner}</PARAM>'


def value(name: str, of: str) -> str:
    """A parameter of a type."""
    return f'<PARAM xsi:type="VALUE"><SHORT-NAME>{name}</SHORT-NAME><DOP-REF ID-REF="{of}"/></PARAM>'


def repeated(name: str) -> str:
    """A parameter that repeats the first byte of the request."""
    inner = f"<SHORT-NAME>{name}</SHORT-NAME><REQUEST-BYTE-POS>0</REQUEST-BYTE-POS><BYTE-LENGTH>1</BYTE-LENGTH>"
    return f'<PARAM xsi:type="MATCHING-REQUEST-PARAM">{inner}</PARAM>'


def message(tag: str, name: str, parts: Iterable[str]) -> str:
    """A structure, a request or an answer, of parameters."""
    return named(tag, name, f"<PARAMS>{''.join(parts)}</PARAMS>", prefix=f"{tag}." if tag != "STRUCTURE" else "")


def texts(name: str, by_number: Mapping[int, str]) -> str:
    """A type of one byte whose values have names."""
    scales = "".join(
        f"<COMPU-SCALE><LOWER-LIMIT>{number}</LOWER-LIMIT><UPPER-LIMIT>{number}</UPPER-LIMIT>"
        f"<COMPU-CONST><VT>{escape(text)}</VT></COMPU-CONST></COMPU-SCALE>"
        for number, text in by_number.items()
    )
    method = f"<COMPU-INTERNAL-TO-PHYS><COMPU-SCALES>{scales}</COMPU-SCALES></COMPU-INTERNAL-TO-PHYS>"
    return named(
        "DATA-OBJECT-PROP",
        name,
        f"<COMPU-METHOD><CATEGORY>TEXTTABLE</CATEGORY>{method}</COMPU-METHOD>{CODED.format(8)}",
        '<PHYSICAL-TYPE BASE-DATA-TYPE="A_UNICODE2STRING"/>',
    )


def service(name: str, semantic: str, states: Iterable[str]) -> str:
    """A service with the request and the answer of this name, in states that it may be asked for in."""
    needed = "".join(f'<PRE-CONDITION-STATE-REF ID-REF="{state}"/>' for state in states)
    return (
        f'<DIAG-SERVICE ID="service.{name}" SEMANTIC="{semantic}" ADDRESSING="PHYSICAL">'
        f"<SHORT-NAME>{name}</SHORT-NAME><PRE-CONDITION-STATE-REFS>{needed}</PRE-CONDITION-STATE-REFS>"
        f'<REQUEST-REF ID-REF="REQUEST.{name}"/>'
        f'<POS-RESPONSE-REFS><POS-RESPONSE-REF ID-REF="POS-RESPONSE.{name}"/></POS-RESPONSE-REFS></DIAG-SERVICE>'
    )


def chart(name: str, semantic: str, states: Iterable[str]) -> str:
    """A state chart that begins in the first of its states."""
    first, *_ = listed = list(states)
    inner = "".join(named("STATE", state) for state in listed)
    return named(
        "STATE-CHART",
        name,
        f'<SEMANTIC>{semantic}</SEMANTIC><START-STATE-SNREF SHORT-NAME="{first}"/><STATES>{inner}</STATES>',
    )
