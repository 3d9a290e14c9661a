"""A release's numbers in an image: the bytes that the compiler makes of them, and the same ECU in other memory."""

import struct
import subprocess
from dataclasses import replace
from pathlib import Path
from random import Random

import numpy as np
import pytest

from can_bridge.wire.messages import Mode
from contract.config.tree import Config
from contract.controller import image_payload as payloads
from contract.controller.c_folder import ECU_SETTINGS, ProgramSettings, library_sources
from contract.errors import BundleContainerError, LibraryError
from contract.release.bundle import load
from contract.release.controller_image import HEADER_BYTES, read
from contract.shipped import BUNDLE
from ecu.c.sources import firmware_sources
from ecu.in_c.c_ecu import CEcu
from ecu.in_c.c_image import controller_image
from ecu.in_c.c_settings import ecu_settings
from ecu.in_c.compiler import host_compiler
from examples.c_samples import MODEL, MPC
from examples.random_programs import random_program
from export.int8 import rounded_estimator, rounded_on
from export.program.controller_program import random_windows
from export.to_c.estimator import estimator_files
from export.to_c.library import c_library
from export.to_onnx.sensor_estimator import build_estimator
from tests.c_builds import SharedBuilds
from tests.ecu.in_c.exported import CONFIG, Feed
from tests.ecu.in_c.test_estimator_in_c import random_network

pytestmark = pytest.mark.compiler
# Both kinds have the arrays of a float32 release and one code that opens them; int8 has the estimator beside.
KINDS = ["int8", pytest.param("float32", marks=pytest.mark.proofs)]

SHIM = Path(__file__).with_name("c").joinpath("from_image.c").read_bytes()
WINDOW = 8  # the shortest with a sensor estimator in C; the jets stay shut until it is full
OK, OTHER_BUILD, MISALIGNED = range(3)


def made(kind: str, seed: int, prior_memory: int = 0):
    """Files of a random release of a kind, the release, and the vehicle."""
    config = Config() if kind == "int8" else CONFIG
    program = random_program(seed, model=replace(MODEL, window=WINDOW), mpc=MPC, prior_memory=prior_memory)
    windows = random_windows(program, 10)
    files = c_library(rounded_on(program, windows) if kind == "int8" else program, windows)
    bundle = load(BUNDLE)
    estimator, mpc = bundle.manifest.sensor_estimator, bundle.manifest.mpc
    assert estimator is not None
    manifest = replace(
        bundle.manifest,
        window=WINDOW,
        program_sha256=ProgramSettings.of(files).text("SW_PROGRAM_SHA256"),
        mpc=replace(mpc, weights=replace(mpc.weights, lift=0.1 * seed)),
        sensor_estimator=replace(estimator, fast=tuple(tuple(seed * value for value in row) for row in estimator.fast)),
    )
    bundle = replace(bundle, manifest=manifest, digest=f"{seed:064x}"[::-1])
    files |= firmware_sources() | {ECU_SETTINGS: ecu_settings(bundle, config)}
    if kind == "int8":
        network = rounded_estimator(random_network(seed, rows=WINDOW))
        files |= estimator_files(build_estimator(network).SerializeToString())
    return payloads.with_layout(files), bundle, config


class Stepped(CEcu):
    def __init__(self, files):
        super().__init__({**files, "shim.c": SHIM}, flags=("-O0", "-ffp-contract=off"))
        self.structs.ffi.cdef("int start(sw_ecu *, const uint8_t *); void places(const sw_ecu *, const void **);")

    def start(self, image: bytes, apart: int = 0) -> int:
        ffi = self.structs.ffi
        room = ffi.new("uint8_t[]", len(image) + 128)
        self.image = room + (-int(ffi.cast("uintptr_t", room)) % 64 + apart)
        self.kept = room
        ffi.memmove(self.image, image, len(image))
        return self.lib.start(self.ecu, self.image)

    def numbers(self, sizes: list[int]) -> list[bytes]:
        found = self.structs.ffi.new("void *[4]")
        self.lib.places(self.ecu, found)
        return [bytes(self.structs.ffi.buffer(place, size)) for place, size in zip(found, sizes, strict=True) if size]

    def lived(self, config: Config):
        """Frames and states of some periods into control."""
        feed, found = Feed(config), []
        for now_ns, frames in feed.driven([1.0] * (WINDOW + 12)):
            found.append((self.step(now_ns, frames), self.saved(), self.trace.action, self.trace.mode))
        return found


@pytest.mark.parametrize("kind", KINDS)
def test_an_image_is_what_the_compiler_makes_and_runs_in_any_build_of_its_layout(kind):
    (files, bundle, config), (others, other, _) = made(kind, 1), made(kind, 2)
    one, two = Stepped(files), Stepped(others)
    images = [controller_image(files, bundle, config, None), controller_image(others, other, config, None)]
    payload, facts = read(images[1]).payload, read(images[1]).facts
    layout = payloads.layout_in(payload, facts.layout)
    sizes = [int(layout.get(f"SW_{name}_BYTES", 0)) for name in ("RELEASE", "WEIGHTS", "HOT", "ESTIMATOR")]
    assert [size > 0 for size in sizes] == [True, True, kind == "int8", kind == "int8"]
    compiled_in, lived = two.numbers(sizes), two.lived(config)
    assert {mode for *_, mode in lived} >= {Mode.OFF, Mode.CONTROL} and any(action != 0 for *_, action, _ in lived)
    # The release that is compiled in is another one.
    assert one.lived(config) != lived
    assert one.start(images[1]) == OK
    assert one.numbers(sizes) == compiled_in
    assert one.lived(config) == lived
    # And back; the wrong ones leave all as it is.
    assert one.start(images[1], apart=8) == MISALIGNED
    wrong = bytearray(images[1])
    for place in (48, 79):
        wrong[place] ^= 1
        assert one.start(bytes(wrong)) == OTHER_BUILD
        wrong[place] ^= 1
    wrong[8:12] = (HEADER_BYTES + 64).to_bytes(4, "little")
    assert one.start(bytes(wrong)) == OTHER_BUILD
    # Tools read the same numbers by their names.
    arrays = payloads.arrays_in(payload, layout)
    np.testing.assert_array_equal(arrays["release.bundle_hash"], [other.short_hash])
    weights = np.array(other.manifest.mpc.weights.as_tuple(), np.float32)
    np.testing.assert_array_equal(arrays["release.weights"], weights)
    assert {values.dtype.kind for name, values in arrays.items() if name.endswith("_rows")} <= {"i"}
    with pytest.raises(BundleContainerError, match="its layout text"):
        payloads.layout_in(payload[:-1], facts.layout)
    with pytest.raises(LibraryError, match="does not belong to the program of bundle"):
        controller_image(others, bundle, config, None)
    with pytest.raises(LibraryError, match="no ECU in C"):
        controller_image({name: text for name, text in files.items() if name != ECU_SETTINGS}, bundle, config, None)


SANITISERS = (
    *("-O0", "-ffp-contract=off", "-fno-sanitize-recover=all"),
    "-fsanitize=address,undefined,float-divide-by-zero,float-cast-overflow",
)
OPENED = Path(__file__).with_name("c").joinpath("opened_images.c").read_bytes()
BAD_NUMBERS = 3
TOGETHER = 8  # arrays at their limits in one image
REFUSED = (
    *(("weights.prior_filter_rows", values) for values in ((140, 1), (3, 2), (-1, 1), (0, 3))),
    *(("release.resting", values) for values in ((1.0, -0.5, 0.5), (np.nan, -0.5, 0.5), (1.0, np.nan, 0.5))),
    *(("release.base", (255,)), ("release.pairs", (4,)), ("release.slowest", (0.2,))),
)
"""All numbers of an array; those of the constants that it interleaves."""


def number(*values: int) -> bytes:
    return struct.pack(f"<{len(values)}I", *values)


class Altered:
    """An image in order, what its numbers may be, and a program that opens and runs it, altered, under sanitisers."""

    def __init__(self, kind: str, folder: Path, builds: SharedBuilds) -> None:
        files, bundle, config = made(kind, 1, prior_memory=4)
        self.image = controller_image(files, bundle, config, None)
        found = read(self.image)
        self._payload, self._layout = found.payload, found.facts.layout
        layout = payloads.layout_in(self._payload, self._layout)
        self.limits = list(payloads.limits_in(payloads.members_in(layout), layout))
        self._program = folder / "opened"
        sources = {**library_sources(files), "opened_images.c": OPENED}
        builds.compile_c(sources, self._program, compiler=host_compiler(), flags=SANITISERS)
        periods = list(Feed(config).driven([1.0] * (WINDOW + 3)))  # into control, too
        self._periods = number(len(periods))
        for now_ns, frames in periods:
            self._periods += struct.pack("<qI", now_ns, len(frames))
            for frame in frames:
                self._periods += struct.pack("<qII", now_ns, frame.frame_id, len(frame.data)) + frame.data

    def opened(self, patches: list[dict[int, bytes]], *, runs: bool = True) -> list[tuple[int, bool]]:
        """Of each image with other bytes at places of its payload: the answer, and whether its controller ran."""
        sent = number(len(self.image)) + self.image + (self._periods if runs else number(0))
        for patch in patches:
            sent += number(len(patch))
            for place, content in patch.items():
                sent += number(HEADER_BYTES + place, len(content)) + content
        done = subprocess.run([self._program], input=sent, capture_output=True, check=False)
        assert (done.returncode, done.stderr[:3000]) == (0, b"")
        return [(int(status), ran == b"1") for status, ran in (line.split() for line in done.stdout.splitlines())]

    def in_python(self, patch: dict[int, bytes]) -> int:
        payload = bytearray(self._payload)
        for place, content in patch.items():
            payload[place : place + len(content)] = content
        try:
            payloads.check_numbers(bytes(payload), self._layout)
        except BundleContainerError:
            return BAD_NUMBERS
        return OK


def packed(one: payloads.Limits, value: float, count: int = 1) -> bytes:
    return np.full(count, value).astype(np.dtype(one.dtype).newbyteorder("<")).tobytes()


def beyond(one: payloads.Limits) -> list[float]:
    """Numbers near the limits, on both sides, and then what is none, without end, or no normal one."""
    near, dtype = (one.least - 1, one.least, one.most, one.most + 1), np.dtype(one.dtype)
    if dtype.kind == "f":
        return [*near, np.nan, -np.inf, 1e-40]
    info = np.iinfo(dtype)
    return [value for value in (*near, info.min, info.max) if info.min <= value <= info.max]


@pytest.mark.slow  # compiles with sanitisers, and opens a thousand images
@pytest.mark.parametrize("kind", KINDS)
def test_no_number_of_an_image_leads_out_of_an_array(kind, tmp_path, shared_builds):
    altered, random = Altered(kind, tmp_path, shared_builds), Random(kind)
    assert altered.opened([{}]) == [(OK, True)]
    # One number at a time: the first of an array, and its last one near its limits.
    patches = []
    for one in altered.limits:
        for group, at in {(0, 0), (one.groups - 1, one.run - 1)}:
            place = one.place + group * one.stride + at * np.dtype(one.dtype).itemsize
            patches += [{place: packed(one, value)} for value in beyond(one)[:: 3 if at or group else 2]]
    found = altered.opened(patches, runs=False)
    assert {status for status, _ in found} == {OK, BAD_NUMBERS}
    assert [status for status, _ in found] == [altered.in_python(patch) for patch in patches]
    # Whole arrays at their limits, each at either end among others at theirs: none is refused, and all can be run.
    bound = ("filter_rows", "resting", "slowest")
    free = [one for one in altered.limits if not any(name in one.name for name in bound)]
    at_most, whole = {one.place: random.random() < 0.5 for one in free}, list[dict[int, bytes]]()
    for turned in (False, True):
        random.shuffle(free)
        for begin in range(0, len(free), TOGETHER):
            whole.append({})
            for one in free[begin : begin + TOGETHER]:
                text = packed(one, one.most if at_most[one.place] is turned else one.least, one.run)
                whole[-1] |= {one.place + group * one.stride: text for group in range(one.groups)}
    assert {status for status, _ in altered.opened(whole)} == {OK}
    assert {altered.in_python(patch) for patch in whole} == {OK}
    # By name, and what numbers within their limits are not together.
    for name, values in REFUSED:
        rows = zip((one for one in altered.limits if one.name == name), values, strict=False)
        places = ((one, value, one.place + k * one.stride) for one, value in rows for k in range(one.groups))
        patch = {place: packed(one, value, one.run) for one, value, place in places}
        expected = BAD_NUMBERS if patch else OK
        assert (altered.opened([patch])[0][0], altered.in_python(patch)) == (expected, expected), (name, values)
    judged = {one.name.removeprefix("weights.") for one in altered.limits}
    assert judged >= {f"prior_{name}" for name in ("filter_rows", "first", "first_scale", "gate", "sums", "sums_scale")}
