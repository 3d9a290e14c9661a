"""The PDX file (ISO 22901-1): an archive of the diagnostic layer, the communication parameters and a catalogue."""

import io
import zipfile
from collections.abc import Iterator, Mapping
from importlib.resources import files
from string import Template
from typing import Final
from xml.sax.saxutils import escape

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.verdicts import Verdict
from can_bridge.odx.services import Described, described
from can_bridge.odx.xml import chart, constant, message, named, repeated, service, texts, value
from can_bridge.uds.fault_codes import CODES, Snapshot, in_letters
from can_bridge.uds.permissions import SERVICES
from can_bridge.uds.services import P2_EXTENDED_MS, P2_MS, S3_MS, Nrc, Session
from can_bridge.wire.messages import SENSORS, Mode, Reason
from contract.config.diagnosis import CanId
from contract.config.vehicle import BusConfig
from contract.controller.calibration import NAMES

_POSITIVE: Final = 0x40
_SNAPSHOT_TYPES: Final = {
    Snapshot.TIME_MS: ("u32",),
    Snapshot.MODE_BEFORE: ("mode",),
    Snapshot.MISSED: ("u16",),
    Snapshot.OVERRUNS: ("u16",),
    Snapshot.PRESSURES_CP: ("f32",) * SENSORS,
}


def pdx(bus: BusConfig, because: Mapping[Reason, str]) -> bytes:
    """The file's content, for an ECU on this bus; `because` has the texts of the trouble codes."""
    packed = io.BytesIO()
    listed = {file.name: file.read_text(encoding="utf-8") for file in files(__package__).joinpath("files").iterdir()}
    with zipfile.ZipFile(packed, "w") as archive:
        for name, text in sorted(listed.items()):
            # Equal descriptions are equal bytes: the time of every file is that of the format's beginning.
            filled = Template(text).substitute(_filling(bus, because)) if name.endswith(".odx-d") else text
            archive.writestr(zipfile.ZipInfo(name), filled, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def _filling(bus: BusConfig, because: Mapping[Reason, str]) -> dict[str, object]:
    every, is_fd, ids = list(described()), bus.frames == "fd", bus.diagnosis
    return {
        "codes": "".join(_code(reason, code, because[reason]) for reason, code in CODES.items()),
        "texts": texts("session", {one: _words(one.name) for one in Session})
        + texts("nrc", {one: _words(one.name) for one in Nrc})
        + texts("verdict", {one: one.in_words for one in Verdict})
        + texts("mode", {one: one.name for one in Mode}),
        "structures": "".join(_structures()),
        "services": "".join(service(one.name, one.service.name, _states(one)) for one in every),
        "requests": "".join(message("REQUEST", one.name, (*_head(one), *one.request)) for one in every),
        "answers": "".join(message("POS-RESPONSE", one.name, (*_head(one, _POSITIVE), *one.answer)) for one in every),
        "refusal": constant("sid", 0x7F) + repeated("service") + value("code", "nrc"),
        "charts": chart("session_chart", "SESSION", map(_session, Session))
        + chart("level_chart", "SECURITY", ["level_locked", *map(_level, Level)]),
        "id_bits": 29 if ids.request.is_extended else 11,
        "request_id": ids.request.number,
        "response_id": ids.response.number,
        "functional": "" if ids.functional is None else _functional(ids.functional),
        "frame_length": "TX_DL = 64 (CANFD)" if is_fd else "TX_DL = 8 (CAN)",
        "p2_us": P2_MS * 1000,
        "p2_star_us": P2_EXTENDED_MS * 1000,
        "present_us": S3_MS * 500,
        "nominal_bitrate": bus.nominal_bitrate,
        "data_bitrate": bus.data_bitrate if is_fd else bus.nominal_bitrate,
    }


def _functional(used: CanId) -> str:
    bits = 29 if used.is_extended else 11
    values = {"Format": f"normal segmented {bits}-bit transmit with FC", "Id": used.number}
    return "".join(
        f'<COMPARAM-REF ID-REF="CP_CanFuncReq{name}" DOCREF="ISO_15765_2" DOCTYPE="COMPARAM-SUBSET">'
        f"<SIMPLE-VALUE>{value}</SIMPLE-VALUE></COMPARAM-REF>"
        for name, value in values.items()
    )


def _code(reason: Reason, code: int, text: str) -> str:
    display = f"<DISPLAY-TROUBLE-CODE>{in_letters(code)}</DISPLAY-TROUBLE-CODE>"
    described = f"<TEXT>{reason.name}: {escape(text)}</TEXT>"
    name = in_letters(code).replace("-", "_")
    return named("DTC", name, f"<TROUBLE-CODE>{code}</TROUBLE-CODE>", display, described)


def _structures() -> Iterator[str]:
    values = (*(value(name, "f32_little") for name in NAMES[:-1]), value(NAMES[-1], "u32_little"))
    yield message("STRUCTURE", "calibration", values)
    limits = (value(name, "calibration") for name in ("least", "greatest", "release"))
    yield message("STRUCTURE", "calibration_limits", limits)
    yield message("STRUCTURE", "fault", (value("code", "code"), value("status", "u8")))
    kept = [value("record", "u8"), constant("identifiers", len(Snapshot))]
    for one, types in _SNAPSHOT_TYPES.items():
        kept.append(constant(f"identifier_{one:04X}", one, 16))
        kept += (value(f"{one.name.lower()}_{place}", of) for place, of in enumerate(types))
    yield message("STRUCTURE", "snapshot", kept)
    yield message("STRUCTURE", "extended", (value("record", "u8"), value("age", "u8")))


def _head(one: Described, more: int = 0) -> Iterator[str]:
    yield constant("sid", one.service + more)
    yield from (constant(f"constant_{place}", *each) for place, each in enumerate(one.constants))


def _states(one: Described) -> Iterator[str]:
    yield from map(_session, sorted(one.permission.sessions & SERVICES[one.service].sessions))
    if one.permission.level is not None:
        yield _level(one.permission.level)


def _session(session: Session) -> str:
    return f"session_{session.name.lower()}"


def _level(level: Level) -> str:
    return f"level_{level.name.lower()}"


def _words(name: str) -> str:
    return name.lower().replace("_", " ")
