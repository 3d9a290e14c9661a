"""A release's numbers in an image: the bytes that the compiler makes of them, and the same ECU in other memory."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from can_bridge.wire.messages import Mode
from contract.config.tree import Config
from contract.controller.c_folder import ECU_SETTINGS, Settings
from contract.controller.image_payload import arrays_in, layout_in, with_layout
from contract.errors import BundleContainerError, LibraryError
from contract.release.bundle import load
from contract.release.controller_image import HEADER, read
from contract.shipped import BUNDLE
from examples.c_samples import MODEL, MPC
from examples.random_programs import random_linear_program, random_program
from export.int8.calibrate import rounded_on
from export.int8.rounded_estimator import rounded_estimator
from export.program.random_windows import random_windows
from export.release.lowering import library_of
from export.to_c.estimator import estimator_files
from export.to_c.library import ecu_sources
from export.to_c.linear_library import linear_c_library
from export.to_onnx.sensor_estimator import build_estimator
from firmware_sim.in_c.c_ecu import CEcu
from firmware_sim.in_c.c_image import controller_image
from firmware_sim.in_c.c_settings import ecu_settings
from tests.export.to_c.ecu.test_estimator import random_network
from tests.firmware_sim.ecu_in_c import CONFIG, Feed

pytestmark = pytest.mark.compiler

SHIM = Path(__file__).with_name("c").joinpath("from_image.c").read_bytes()
DECLARED = "int start(sw_ecu *, const uint8_t *); void places(const sw_ecu *, const void **);"
PERIODS = 60
OK, OTHER_BUILD, MISALIGNED = range(3)


def made(kind: str, seed: int):
    """Files of a random release of a kind, the release, and the vehicle."""
    config = Config() if kind == "int8" else CONFIG
    program = random_program(seed, model=MODEL, mpc=MPC)
    windows = random_windows(program, 10)
    if kind == "linear":
        files = linear_c_library(random_linear_program(seed, window=32, mpc=MPC))
    else:
        files = library_of(rounded_on(program, windows) if kind == "int8" else program, windows)
    bundle = load(BUNDLE)
    estimator, mpc = bundle.manifest.sensor_estimator, bundle.manifest.mpc
    assert estimator is not None
    manifest = replace(
        bundle.manifest,
        program_sha256=Settings.of(files).text("SW_PROGRAM_SHA256"),
        mpc=replace(mpc, weights=replace(mpc.weights, lift=0.1 * seed)),
        sensor_estimator=replace(estimator, fast=tuple(tuple(seed * value for value in row) for row in estimator.fast)),
    )
    bundle = replace(bundle, manifest=manifest, digest=f"{seed:064x}"[::-1])
    files |= ecu_sources() | {ECU_SETTINGS: ecu_settings(bundle, config)}
    if kind == "int8":
        files |= estimator_files(build_estimator(rounded_estimator(random_network(seed))).SerializeToString())
    return with_layout(files), bundle, config


class Stepped(CEcu):
    """An ECU that can be started from an image."""

    def __init__(self, files):
        super().__init__({**files, "shim.c": SHIM}, flags=("-O1", "-ffp-contract=off"))
        self.structs.ffi.cdef(DECLARED)

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
        for now_ns, frames in feed.driven([1.0] * PERIODS):
            found.append((self.step(now_ns, frames), self.saved(), self.trace.action, self.trace.mode))
        return found


@pytest.mark.parametrize("kind", ["int8", "float32", "linear"])
def test_an_image_is_what_the_compiler_makes_and_runs_in_any_build_of_its_layout(kind):
    (files, bundle, config), (others, other, _) = made(kind, 1), made(kind, 2)
    one, two = Stepped(files), Stepped(others)
    images = [controller_image(files, bundle, config, None), controller_image(others, other, config, None)]
    payload, facts = read(images[1]).payload, read(images[1]).facts
    layout = layout_in(payload, facts.layout)
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
    wrong[8:12] = (HEADER + 64).to_bytes(4, "little")
    assert one.start(bytes(wrong)) == OTHER_BUILD
    # Tools read the same numbers by their names.
    arrays = arrays_in(payload, layout)
    np.testing.assert_array_equal(arrays["release.bundle_hash"], [other.short_hash])
    weights = np.array(other.manifest.mpc.weights.as_tuple(), np.float32)
    np.testing.assert_array_equal(arrays["release.weights"], weights)
    assert {values.dtype.kind for name, values in arrays.items() if name.endswith("_rows")} <= {"i"}
    with pytest.raises(BundleContainerError, match="no text of its layout"):
        layout_in(payload[:-1], facts.layout)
    with pytest.raises(LibraryError, match="not of the program of bundle"):
        controller_image(others, bundle, config, None)
    with pytest.raises(LibraryError, match="no ECU in C"):
        controller_image({name: text for name, text in files.items() if name != ECU_SETTINGS}, bundle, config, None)
