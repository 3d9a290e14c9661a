"""Authentication in C: AES and CMAC by the standards' answers and another library's; frames as in Python."""

from dataclasses import replace
from typing import Any

import cffi
import pytest
from cryptography.hazmat.primitives.ciphers import Cipher, algorithms, modes
from cryptography.hazmat.primitives.cmac import CMAC
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import LARGEST_HALF, Authentication, Freshness, verify
from can_bridge.wire.message_sets import SECURED
from can_bridge.wire.messages import Mode, Reason
from contract.config.vehicle import BusConfig
from contract.controller.c_folder import ECU_SETTINGS, library_sources
from contract.errors import ConfigError, LibraryError
from ecu.c.sources import sources_in
from ecu.ecu import Ecu
from ecu.in_c.c_ecu import CEcu, ecu_sources
from ecu.in_c.compiler import host_compiler
from ecu.in_c.host_library import CController
from tests.ecu.in_c.exported import CONFIG, WINDOW, Feed

pytestmark = pytest.mark.compiler

FLAGS = ("-O1", "-ffp-contract=off")
KEYED = replace(CONFIG, bus=BusConfig(key="bus.key"))
SECRET = bytes.fromhex("2b7e151628aed2a6abf7158809cf4f3c")
"""The key of NIST's and RFC 4493's examples."""
NIST = (
    # FIPS 197.
    ("000102030405060708090a0b0c0d0e0f", "00112233445566778899aabbccddeeff", "69c4e0d86a7b0430d8cdb78070b4c55a"),
    # SP 800-38A, F.1.1.
    (SECRET.hex(), "6bc1bee22e409f96e93d7e117393172a", "3ad77bb40d7a3660a89ecaf32466ef97"),
    (SECRET.hex(), "ae2d8a571e03ac9c9eb76fac45af8e51", "f5d3d58503b9699de785895a96fdbaaf"),
    (SECRET.hex(), "30c81c46a35ce411e5fbc1191a0a52ef", "43b1cd7f598ece23881b00e3ed030688"),
    (SECRET.hex(), "f69f2445df4f9b17ad2b417be66c3710", "7b0c785e27e8ad3f8223207104725dd4"),
    # AESAVS, the first of GFSbox, KeySbox, VarTxt and VarKey.
    ("0" * 32, "f34481ec3cc627bacd5dc3fb08f273e6", "0336763e966d92595a567cc9ce537f5e"),
    ("10a58869d74be5a374cf867cfb473859", "0" * 32, "6d251e6944b051e04eaa6fb4dbf78465"),
    ("0" * 32, "8" + "0" * 31, "3ad78e726c1ec02b7ebfe92b23d9ec34"),
    ("8" + "0" * 31, "0" * 32, "0edd33d3c621e546455bd8ba1418bec8"),
)
"""Key, block, and the block encrypted."""
RFC_4493 = {
    0: "bb1d6929e95937287fa37d129b756746", 16: "070a16b46b4d4144f79bdd9dd04a287c",
    40: "dfa66747de9ae63030ca32611497c827", 64: "51f0bebf7e3b9d92fc49741779363cfe",
}  # fmt: skip
"""CMAC of so many bytes of the four blocks of SP 800-38A."""
BLOCKS = st.binary(min_size=16, max_size=16)


class Crypto:
    """AES and CMAC in C, compiled with a sanitiser that traps."""

    def __init__(self, library: Any, ffi: Any) -> None:
        self._c, self._ffi = library, ffi

    def encrypted(self, key: bytes, block: bytes) -> bytes:
        prepared, found = self._ffi.new("uint16_t[88]"), self._ffi.new("uint8_t[16]", block)
        self._c.sw_aes_prepare(prepared, key)
        self._c.sw_aes_encrypt(prepared, found)
        return bytes(found)

    def cmac(self, key: bytes, message: bytes) -> bytes:
        found = self._ffi.new("uint8_t[16]")
        self._c.sw_aes_cmac(key, message, len(message), found)
        return bytes(found)


@pytest.fixture(scope="module")
def crypto(shared_builds, tmp_path_factory) -> Crypto:
    path = tmp_path_factory.mktemp("crypto") / "crypto.so"
    trapped = ("-fsanitize=undefined", "-fsanitize-undefined-trap-on-error")
    flags = ("-O1", "-shared", "-fPIC", "-Wshadow", *(trapped if "gcc" in host_compiler()[0] else ()))
    shared_builds.compile_c(sources_in("secoc"), path, compiler=host_compiler(), flags=flags)
    ffi: Any = cffi.FFI()
    ffi.cdef(
        "void sw_aes_prepare(uint16_t *, const uint8_t *); void sw_aes_encrypt(const uint16_t *, uint8_t *);"
        "void sw_aes_cmac(const uint8_t *, const uint8_t *, uint32_t, uint8_t *);"
    )
    return Crypto(ffi.dlopen(str(path)), ffi)


def test_aes_and_cmac_give_the_answers_of_nist_and_of_rfc_4493(crypto):
    for key, block, expected in NIST:
        assert crypto.encrypted(bytes.fromhex(key), bytes.fromhex(block)).hex() == expected, key
    message = b"".join(bytes.fromhex(block) for _, block, _ in NIST[1:5])
    assert {length: crypto.cmac(SECRET, message[:length]).hex() for length in RFC_4493} == RFC_4493


@given(key=BLOCKS, block=BLOCKS, message=st.binary(max_size=99))
def test_aes_and_cmac_are_another_librarys(crypto, key, block, message):
    assert crypto.encrypted(key, block) == Cipher(algorithms.AES(key), modes.ECB()).encryptor().update(block)
    made = CMAC(algorithms.AES(key))
    made.update(message)
    assert crypto.cmac(key, message) == made.finalize()


def genuine() -> Feed:
    """A vehicle that authenticates."""
    return Feed(KEYED, Authentication(key=Key(SECRET), trip=2))


def test_the_ecu_sends_and_remembers_what_the_python_ecu_does(release):
    """Through the binding; `tests/proofs/ecu_in_c` compares both under every attack: forged, old, repeated frames."""
    own = ecu_sources(release.folder, release.bundle, KEYED)
    assert not [name for name, text in own.items() if SECRET.hex().encode() in text or b"bus.key" in text]
    controller = CController(library_sources(own), release.bundle.manifest.sizes, flags=FLAGS)
    python = Ecu(release.bundle, controller, KEYED, authentication=Authentication(key=Key(SECRET)))
    c, seen = CEcu(own, flags=FLAGS, secret=SECRET), set()
    for period, (now_ns, frames) in enumerate(genuine().periods(WINDOW + 16, damaged=(WINDOW + 6, WINDOW + 8))):
        if period == WINDOW + 9:
            c.restore(python.state)
        sent = c.step(now_ns, frames)
        assert sent == python.step(now_ns, frames), period
        assert c.differing(python.state) == [], period
        assert c.status() == python.status()
        for frame, spec in zip(sent, (SECURED.command.spec, SECURED.status.spec), strict=True):
            assert verify(frame.data, spec, Key(SECRET)) == 1 << 32 | period
        seen.add((c.trace.mode, c.status().reason))
    assert {(Mode.CONTROL, Reason.NONE), (Mode.HOLD, Reason.NOT_AUTHENTIC)} <= seen
    assert (c.state.verifier.not_authentic, c.state.verifier.not_fresh) == (2, 0)
    # The last values of both halves stay, in C as in Python.
    ended = replace(python.state, freshness=Freshness(trip=LARGEST_HALF, count=LARGEST_HALF))
    for ecu in (c, python):
        ecu.restore(ended)
    assert c.step(now_ns + 1, []) == python.step(now_ns + 1, [])
    assert c.state.freshness == python.state.freshness == ended.freshness


def test_before_power_off_it_shuts_the_jets_by_frames_that_are_accepted(release):
    """As `docs/how-to/integrate-the-ecu.md` says under "Safe states"."""
    c, now_ns = CEcu(ecu_sources(release.folder, release.bundle, KEYED), flags=FLAGS, secret=SECRET), 0
    for now_ns, frames in genuine().periods(WINDOW + 16):
        c.step(now_ns, frames)
    state, secoc, ffi = c.ecu.state, c.structs.ffi.buffer(c.structs.ffi.addressof(c.ecu, "secoc")), c.structs.ffi
    saved = bytes(secoc), bytes(ffi.buffer(ffi.addressof(state.freshness))), state.command_counter, state.status_counter
    c.lib.sw_ecu_init(c.ecu)
    assert c.step(now_ns, []) == []
    c.lib.sw_ecu_init(c.ecu)
    secoc[:], ffi.buffer(ffi.addressof(state.freshness))[:], state.command_counter, state.status_counter = saved
    for period in range(3):
        now_ns += CONFIG.period_ns
        command, _ = c.step(now_ns, [])
        assert verify(command.data, SECURED.command.spec, Key(SECRET)) == 1 << 32 | WINDOW + 16 + period
        parsed = SECURED.command.parse(command.data[: SECURED.command.spec.protected])
        assert parsed is not None and (parsed.enable, parsed.flow_m2_per_s) == (False, 0.0)


def test_without_its_key_it_sends_nothing_and_believes_nothing(release, sources):
    own = ecu_sources(release.folder, release.bundle, KEYED)
    mute = CEcu(own, flags=FLAGS)
    assert [mute.step(now_ns, frames) for now_ns, frames in genuine().periods(5)] == [[]] * 5
    assert mute.state.verifier.not_authentic == mute.state.frames_rejected == 5
    with pytest.raises(ConfigError, match=r"bus\.key: is a key of zeros"):
        CEcu(own, flags=FLAGS, secret=bytes(16))
    with pytest.raises(LibraryError, match="a bus without a key"):
        CEcu(sources, flags=FLAGS, secret=SECRET)
    assert b"#define SW_SECOC 0\n" in sources[ECU_SETTINGS]
