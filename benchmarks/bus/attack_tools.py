"""The results of scapy's scanners on a flashable ECU: ISO-TP, XCP, UDS services, identifiers, security access.

    pip install scapy
    python -m benchmarks attack-tools [--json FILE]

The ECU is `stillwake ecu --slots` with the shipped release in a separate process. It uses classic frames for the
scanners. The benchmark fails if the scanners find a service or identifier that the diagnosis page does not list, or if
they unlock a security level.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import sleep
from typing import Any, Final

from benchmarks.bus import tables
from benchmarks.common.command_line import ROOT, JsonFile, report, stillwake
from can_bridge.uds.services import Did, Service
from contract.errors import StillwakeError
from contract.results import versions
from contract.shipped import BUNDLE

BUS: Final = ("udp_multicast", "239.74.163.78")
XCP_IDS: Final = range(0x7C8, 0x7E0)
ISOTP_IDS: Final = range(0x7D8, 0x7F0)
"""Identifiers for the ISO-TP scan. The identifiers of XCP are left out, because XCP's error frames confuse the
scanner."""
DIDS: Final = (*range(0xF100, 0xF200), *range(0xFD00, 0xFD40))
ABSENT: Final = (0x11, 0x7F)
"""Negative response codes (UDS) for a service that the ECU lacks, or that is missing in the present session only."""


def main(json_file: JsonFile = None) -> None:
    """Run the scans and print the results; fail if the scanners find more than the diagnosis page states."""
    with tempfile.TemporaryDirectory(prefix="stillwake-") as folder, _ecu(Path(folder)):
        figures = _scan()
    report(json_file, figures, {"versions": versions("stillwake", "scapy", "python-can")}, tables.attack_tools)
    services, identifiers = {int(Service(one)) for one in Service}, {int(one) for one in Did}
    beyond = {int(text, 16) for text in figures["services"]} - services
    beyond |= {int(text, 16) for text in figures["identifiers"]} - identifiers
    if beyond or figures["unlocked"] or not figures["requests"]:
        raise StillwakeError(f"scapy found too much: {sorted(map(hex, beyond))}, {figures['unlocked']} levels unlocked")


@contextmanager
def _ecu(place: Path) -> Iterator[None]:
    """Provision the ECU and run it until the block ends; raise StillwakeError if the ECU ends earlier."""
    root, keys, slots, access = (str(place / name) for name in ("root", "keys.list", "slots", "access.key"))
    trusted = ROOT / "contract" / "release" / "release.pub"
    stillwake("keygen", root)
    stillwake("bundle", "keylist", keys, "--key", f"{root}/release.key", "--version", 1, "--allow", trusted)
    stillwake("keygen", "--secret", access)
    stillwake("ecu", "provision", slots, "--root", f"{root}/release.pub", "--keys", keys, "--bundle", BUNDLE)
    words = ["ecu", "--slots", slots, "--access", access, "--bus", ":".join(BUS), "--set", "bus.frames=classic"]
    with subprocess.Popen([sys.executable, "-m", "stillwake", *words], stderr=subprocess.DEVNULL) as process:
        sleep(5.0)
        try:
            yield
            if process.poll() is not None:
                raise StillwakeError(f"the ECU ended with status {process.returncode} during the scans")
        finally:
            process.terminate()


def _scan() -> dict[str, Any]:
    try:
        from scapy.config import conf  # type: ignore[import-not-found,unused-ignore]
    except ImportError as error:
        raise StillwakeError("scapy is not installed: pip install scapy") from error
    conf.contribs["CANSocket"] = {"use-python-can": True}
    conf.contribs["ISOTP"] = {"use-can-isotp-kernel-module": False}
    from scapy.contrib.automotive import uds_scan  # type: ignore[import-not-found,unused-ignore]
    from scapy.contrib.automotive.uds import UDS  # type: ignore[import-not-found,unused-ignore]
    from scapy.contrib.automotive.xcp.scanner import XCPOnCANScanner  # type: ignore[import-not-found,unused-ignore]
    from scapy.contrib.automotive.xcp.xcp import XCPOnCAN  # type: ignore[import-not-found,unused-ignore]
    from scapy.contrib.cansocket import CANSocket  # type: ignore[import-not-found,unused-ignore]
    from scapy.contrib.isotp import ISOTPSoftSocket, isotp_scan  # type: ignore[import-not-found,unused-ignore]

    def port(**more: Any) -> Any:
        return CANSocket(interface=BUS[0], channel=BUS[1], fd=True, hop_limit=0, **more)

    def connected() -> Any:
        return ISOTPSoftSocket(port(), tx_id=0x7E0, rx_id=0x7E8, basecls=UDS)

    with port() as plain:
        transports = isotp_scan(
            plain, ISOTP_IDS, sniff_time=0.1, verify_results=False, output_format="json", verbose=False
        )
    with port(basecls=XCPOnCAN) as for_xcp:
        slaves = XCPOnCANScanner(for_xcp, id_range=XCP_IDS, sniff_time=0.1, verbose=False).scan_with_connect()
    names = ("DSC", "Service", "RDBI", "SA")
    cases = [getattr(uds_scan, f"UDS_{name}Enumerator") for name in names]
    spans = {"DSC": range(1, 5), "RDBI": DIDS, "SA": range(1, 8)}
    ranges = {f"UDS_{name}Enumerator_kwargs": {"scan_range": span} for name, span in spans.items()}
    scanner = uds_scan.UDS_Scanner(connected(), reconnect_handler=connected, test_cases=cases, timeout=0.5, **ranges)
    scanner.scan(timeout=240)
    answers = [
        (bytes(one.req), bytes(one.resp))
        for case in scanner.configuration.test_cases
        for one in case.results
        if one.resp is not None
    ]
    there = {req[0] for req, resp in answers if resp[0] != 0x7F or resp[2] not in ABSENT}
    return {
        "isotp": [f"{one['tx_id']:#x}" for one in json.loads(transports)],
        "xcp": [f"{one.request_id:#x}" for one in slaves],
        "requests": sum(len(case.results) for case in scanner.configuration.test_cases),
        "services": sorted(f"{one:#04x}" for one in there),
        "identifiers": sorted({f"{int.from_bytes(req[1:3], 'big'):#06x}" for req, resp in answers if resp[0] == 0x62}),
        "seeds": sorted({f"{resp[1]:#04x}" for _, resp in answers if resp[0] == 0x67 and resp[1] % 2}),
        "unlocked": sum(resp[0] == 0x67 and resp[1] % 2 == 0 for _, resp in answers),
    }
