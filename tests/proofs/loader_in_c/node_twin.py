"""One ECU in Python and one in C that are given the same frames at the same times: what both send is compared.

The Python one is `FlashableEcu`, with images for microcontrollers in place of bundles.
"""

import hashlib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple
from unittest.mock import patch

import numpy as np

from can_bridge.e2e.profiles import E2eSender
from can_bridge.flashing.checking import Rules, fits_as
from can_bridge.flashing.store import Store
from can_bridge.flashing.verdicts import Verdict
from can_bridge.isotp import control_info
from can_bridge.secoc.securing import Authentication, Freshness, secure
from can_bridge.uds.services import Nrc, Refused
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import Pressure
from contract.config.diagnosis import CanId, DiagnosisConfig
from contract.config.tree import Config
from contract.config.vehicle import BenefitCheckConfig, BusConfig, EcuConfig
from contract.release import controller_image, key_list, signing
from contract.release.checks import Bundle
from contract.release.controller_image import ImageFacts
from ecu.flashable import power_cycle
from ecu.flashable.equipment import Equipment
from ecu.flashable.flashable_ecu import FlashableEcu
from ecu.flashable.vehicle_fit import self_test
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import HARDWARE, RELEASE, ROOT, SECOND, STRANGER, keys, provision
from tests.can_bridge.flashing.store_ecu import KEY, counted
from tests.ecu.conftest import RecordingController
from tests.proofs.ecu.hostile_world import small_bundle
from tests.proofs.ecu_in_c import variants
from tests.proofs.loader_in_c.node_library import SLOT_BYTES, WANTS_RESET, Host, Library
from tests.proofs.loader_in_c.store_library import FACTS, judged, rules

UNCHECKED: Final = EcuConfig(sensor_check=variants.UNCHECKED, benefit_check=BenefitCheckConfig(enabled=False))
IDS: Final = DiagnosisConfig(request_id="0x18DA5AF1", response_id="0x18DAF15A", functional_id="0x18DB33F1")
CONFIGS: Final = {
    "fd": Config(ecu=UNCHECKED),
    "classic": Config(ecu=UNCHECKED, bus=BusConfig(frames="classic", diagnosis=IDS)),
}
OTHERS: Final = {
    "authenticated": Config(ecu=UNCHECKED, bus=BusConfig(key="bus.key")),
    "without XCP": Config(ecu=UNCHECKED, bus=BusConfig(diagnosis=DiagnosisConfig(xcp=False))),
}
"""Vehicles whose builds differ: requests in all states are asked of them as well."""
TEXTS: Final = (HARDWARE, "0815", "bench")
MS: Final = 1_000_000


def facts(config: Config, name: str, version: int = 1, **changes: Any) -> ImageFacts:
    point = config.operating_point
    own = {
        "digest": hashlib.sha256(f"{name} {version}".encode()).digest(), "period_ns": config.period_ns,
        "operating_point": (point.width, point.speed, point.density), "action_limit": config.flow.action_limit,
        "sensors": 4, "hardware": None,
    }  # fmt: skip
    return replace(FACTS, name=name, security_version=version, **{**own, **changes})


def pressures(enable: bool) -> Pressure:
    return Pressure(pressure_pa=(30.0, 60.0, 90.0, 10.0), valid=(True,) * 4, enable_request=enable, age_ns=0)


class World(NamedTuple):
    """What both ECUs live in: a vehicle, a library for it, and what testers send: images by name, `one` is that of
    production; key lists signed by the root key; and others."""

    config: Config
    library: Library
    bundle: Bundle
    images: dict[str, bytes]
    key_lists: tuple[bytes, ...]
    foreign_lists: tuple[bytes, ...]
    vehicle: bytes  # an image's header, made for it


def world(kind: str, library: Library) -> World:
    """Images of all kinds for a vehicle of `CONFIGS` or `OTHERS`."""
    config = (CONFIGS | OTHERS)[kind]
    bundle = small_bundle(config)

    def image(
        name: str, version: int = 1, key: Any = RELEASE, length: int = 6000, first: bytes = b"", **changes: Any
    ) -> bytes:
        found = facts(config, name, version, **changes)
        booted = replace(bundle, digest=found.digest.hex())
        return controller_image.seal(first + library.payload(booted, length)[len(first) :], found, key)

    good = image("newest", 3, length=9001)
    images = {
        **{name: image(name, version) for name, version in (("one", 1), ("old", 0), ('a "quoted\\" name', 2))},
        "newest": good,
        "again": image("again", 3, length=4096 + 600),
        "second": image("second", 2, SECOND, length=4096 - 512),
        "unsigned": image("unsigned", 2, None),
        "stranger's": image("stranger's", 2, STRANGER),
        "other hardware's": image("other", 2, hardware="other"),
        "for this hardware": image("bench", 2, hardware=HARDWARE, length=12_000),
        "of another build": image("build", 2, layout=bytes(32)),
        "of another dbc": image("dbc", 2, dbc=bytes(32)),
        "of another period": image("period", 2, period_ns=1),
        "of another vehicle": image("vehicle", 2, sensors=5),
        "that does not open": image("closed", 2, first=b"\xff"),
        "altered": good[:-1] + b"!",
        "altered header": good[:150] + b"!" + good[151:],
        "no image": bytes(5000),
        "short": bytes(100),
    }
    lists = (keys(1), keys(2, RELEASE, SECOND), keys(3, RELEASE, revoked=(SECOND,)), keys(4, RELEASE, SECOND))
    evil = key_list.encode(replace(key_list.decode(lists[3], signing.public_key(ROOT)), version=9), STRANGER)
    vehicle = controller_image.seal(b"", facts(config, "vehicle"), None)
    return World(config, library, bundle, images, lists, (evil, lists[1][:-1], lists[3] + b"\n"), vehicle)


def frame_to(bus: BusConfig, data: bytes, to: CanId | None = None, now_ns: int = 0) -> Frame:
    """A frame of a bus, by default to the ECU alone."""
    number, is_extended = to or bus.diagnosis.request
    return Frame(frame_id=number, data=data, timestamp_ns=now_ns, is_fd=bus.frames == "fd", is_extended=is_extended)


def may_run(of: World, image: bytes) -> bool:
    """Whether the image is in order, under one of the key lists."""
    allowed = key_list.decode(of.key_lists[1], signing.public_key(ROOT))
    rules = Rules(keys=allowed, hardware=HARDWARE, fits=lambda release: Verdict.GOOD, least_security_version=0)
    return checked(image, rules, of=of)[0] is Verdict.GOOD


def checked(image: bytes, rules: Rules, *, of: World) -> tuple[Verdict, Bundle | None]:
    """The verdict on an image for microcontrollers, and its release as a bundle."""
    verdict, found = judged(image, replace(rules, fits=fits_as(of.vehicle)))
    if found is None:
        return verdict, None
    manifest = replace(of.bundle.manifest, name=found.name, security_version=found.security_version)
    return verdict, Bundle(manifest=manifest, files={}, digest=found.digest, signer=found.signer)


@contextmanager
def as_in_c(of: World) -> Iterator[None]:
    checks_images = partial(Store, check=partial(checked, of=of))
    with patch.object(power_cycle, "Store", checks_images), patch.object(power_cycle, "self_test", _self_test):
        yield


_living: Final = list["Twins"]()


def _self_test(*given: Any) -> Any:
    """In C an image runs where it stands, and one that is written over runs no more."""
    if _living[-1].is_void:
        raise Refused(Nrc.CONDITIONS_NOT_CORRECT)
    yield from self_test(*given)


class _Controller(RecordingController):
    def __init__(self, of: "Twins") -> None:
        super().__init__()
        self._of = of

    def control_step(self, window: Any, *given: Any) -> Any:
        answer, fails = super().control_step(window, *given), self._of.fails
        bad = {4: 1.0, 5: -1.0, 6: 1.0 if window.any() else None, 7: np.nan}.get(fails)
        return answer if bad is None else replace(answer, plan=np.full_like(answer.plan, bad))


class Twins:
    """Both ECUs, just powered on with release "one", or with none. Enter `as_in_c` before. Nothing is compared after
    the first difference; `seen` counts answers by service and code."""

    def __init__(self, of: World, *, first: str | None = "one") -> None:
        self._config = of.config
        image = b"" if first is None else of.images[first]
        self.c = Host(of.library, rules(of.vehicle), TEXTS, image)
        self.backing = provision(PlainBacking(capacity=SLOT_BYTES), image or None, check=partial(checked, of=of))
        equipment = Equipment(
            root=signing.public_key(ROOT),
            access=KEY,
            random_bytes=lambda count: bytes(count) if 1 < self.fails < 4 else seeds(count),
            hardware=TEXTS[0],
            serial=TEXTS[1],
            software=TEXTS[2],
            controller_of=lambda bundle: _Controller(self),
        )
        self._authentication = Authentication(key=variants.KEY) if of.config.bus.key else None
        self._freshness = Freshness(trip=1)
        self.python = FlashableEcu(self.backing, of.config, equipment, authentication=self._authentication)
        _living[:], self.fails, seeds = [self], 0, counted()
        self._waits_for_control, self.reset_ns = False, 0
        self._pressures = E2eSender(message_set(of.config.bus).pressure.spec)
        self.now_ns, self.due_ns = MS, MS
        self.differences = list[str]()
        self.seen = Counter[str]()
        self.compared = 0

    @property
    def is_void(self) -> bool:
        """Whether the release that was booted is written over."""
        return self.python.cycle.boot.slot is not None and self.python.cycle.store.running is None

    def fail(self, what: int) -> None:
        """From now on: 0 nothing, 1 the memory, 2 the source of random bytes gives zeros, 3 it gives none, 4 and 5
        plans are too great, 6 they are on windows that are not zero, 7 they are no numbers."""
        self.fails, self.backing.broken = what, what == 1
        self.c.fail(what)

    def control(self, enable: bool | None) -> list[Frame]:
        """A control period, with pressures unless `enable` is None."""
        frames = [] if enable is None or self.is_void else [self._pressure(enable)]
        self._waits_for_control = False
        return self._compare("control", self.python.step(self.now_ns, frames), self.c.control(self.now_ns, frames))

    def ask(self, *requests: bytes) -> list[Frame]:
        """What both send to requests in one frame each, which come at once; AssertionError if they differ."""
        bus = self._config.bus
        sent = self.service([frame_to(bus, control_info.single(one), None, self.now_ns) for one in requests])
        assert self.differences == []
        return sent

    def service(self, frames: Sequence[Frame]) -> list[Frame]:
        in_python = self.python.service(self.now_ns, frames)
        if self.c.fact(WANTS_RESET):
            assert self.c.service(self.now_ns, frames) == []
            self.c.power_on()
            self._waits_for_control, self.reset_ns, in_c = True, self.now_ns, []
        else:
            in_c = [] if self._waits_for_control else self.c.service(self.now_ns, frames)
        if self.is_void:
            # What a tool measures goes on in Python alone.
            to_tool = self._config.bus.diagnosis.xcp_response
            in_python, in_c = ([one for one in found if one.identifier != to_tool] for found in (in_python, in_c))
        return self._compare("service", in_python, in_c)

    def _compare(self, what: str, in_python: list[Frame], in_c: list[Frame]) -> list[Frame]:
        self.compared += 1
        if what == "control" and self.is_void:
            in_python, in_c = (list(map(self._without_counts, frames)) for frames in (in_python, in_c))
        if in_python != in_c and not self.differences:
            one, other = ([f"{frame.frame_id:x}#{frame.data.hex()}" for frame in some] for some in (in_python, in_c))
            self.differences.append(f"{what} at {self.now_ns} ns: {one} in Python, {other} in C")
        return in_python

    def _without_counts(self, frame: Frame) -> Frame:
        """What of a command or status still goes on in C once the image is written over: not its counts."""
        is_command = frame.frame_id == message_set(self._config.bus).command.spec.frame_id
        data = frame.data[3:5] if frame.is_fd else frame.data[1:3]
        if is_command:
            data = bytes([data[0] & (0x2F if frame.is_fd else 0xFF)])
        return replace(frame, data=data, is_fd=False)

    def _pressure(self, enable: bool) -> Frame:
        of, freshness = message_set(self._config.bus).pressure, self._freshness
        frame = self._pressures.frame(of.emit(pressures(enable)), now_ns=self.now_ns)
        self._freshness = freshness.next()
        return frame if self._authentication is None else secure(frame, of.spec, variants.KEY, freshness)
