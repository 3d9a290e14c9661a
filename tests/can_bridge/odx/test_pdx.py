"""The PDX file as another implementation reads it, and the running server asked and understood by that alone."""

import hashlib
import io
import json
import zipfile
from importlib.metadata import version
from typing import Any

import pytest

from can_bridge.flashing.state import Level
from can_bridge.flashing.verdicts import Verdict
from can_bridge.odx.pdx import pdx, seed_and_key
from can_bridge.uds.fault_memory import CODES, in_letters
from can_bridge.uds.services import Did, Nrc, Routine, Session
from can_bridge.wire.messages import Mode, Reason
from contract.config.controller import CostWeights
from contract.config.diagnosis import DiagnosisConfig
from contract.config.vehicle import BusConfig
from contract.controller.calibration import CALIBRATION_NAMES, Calibration
from contract.release.controller_image import intel_hex, s_records
from firmware_sim.runs.reasons import BECAUSE
from tests.can_bridge.flashing.releases import image, name_of
from tests.can_bridge.flashing.store_ecu import SECRET
from tests.can_bridge.uds.scripted_ecu import Bench
from tests.can_bridge.uds.test_ecu_services import Client
from tests.can_bridge.uds.test_faults import Memory
from tests.can_bridge.uds.test_security import cmac

odxtools = pytest.importorskip("odxtools")
variantmatcher = pytest.importorskip("odxtools.variantmatcher")

VALUES = Calibration(weights=CostWeights(), action_limit=0.0625, command_step=0.03125, delay_steps=3)
BY_NAME = dict(zip(CALIBRATION_NAMES, VALUES.values, strict=True))
ARGUMENTS: dict[str, dict[str, Any]] = {
    "clear_faults": {"group": 0xFFFFFF},
    **{name: {"mask": 0x08} for name in ("faults_count", "faults_by_status")},
    **{name: {"code": CODES[Reason.STREAM_LOST], "record": 1} for name in ("faults_snapshot", "faults_extended")},
    **{name: {"kind": 1} for name in ("enable_sending", "disable_sending")},
    "write_key_list": {"value": b"signed"},
    "write_calibration": {"value": BY_NAME | {"delay_steps": 3}},
    "write_calibration_stored": {"value": 1},
    "routine_erase": {"length": 9, "sha256": bytes(range(32))},
    "download": {"offset": 0, "length": 3},
    "transfer": {"counter": 1, "data": b"abc"},
}
"""Arguments of services that carry more than their constants."""


def database_of(bus: BusConfig) -> Any:
    database = odxtools.database.Database(use_weakrefs=False)
    database.add_pdx_file(io.BytesIO(pdx(bus, BECAUSE)))
    database.refresh()
    return database


def layer_of(bus: BusConfig) -> Any:
    return database_of(bus).base_variants.stillwake_ecu


@pytest.fixture(scope="module")
def layer() -> Any:
    return layer_of(BusConfig())


@pytest.fixture
def bench() -> Bench:
    memory, packed = Memory(), VALUES.pack()
    memory.note(Reason.STREAM_LOST)
    bench = Bench(faults=memory.now)
    bench.ecu.values = {did: b"\x05\x06\x07\x08" for did in Did} | {
        Did.SERIAL_NUMBER: "Nr. 0815 µ".encode(),
        Did.DBC_SHA256: bytes(range(32)),
        Did.PERIOD_NS: bytes(8),
        Did.CALIBRATION: packed,
        Did.CALIBRATION_LIMITS: 3 * packed,
        Did.CALIBRATION_STORED: b"\x01",
    }
    return bench


def ask(bench: Bench, layer: Any, name: str) -> dict[str, Any]:
    """The decoded answer to a service's request, which the layer encodes."""
    service = layer.services[name]
    arguments = dict(ARGUMENTS.get(name, {}))
    if name.startswith("key_"):
        seed = ask(bench, layer, name.replace("key", "seed")).get("seed", bytes(16))
        level = Level[name.removeprefix("key_").upper()]
        arguments["key"] = bench.key.answer(level, bytes(seed))
    bench.ecu.status = {"routine_erase": bytes(4), "routine_check": bytes([Verdict.TOO_OLD])}.get(name, b"")
    answer = bench.ask(service.encode_request(**arguments))
    assert answer is not None
    return dict(service.decode_message(answer).param_dict) if answer[0] != 0x7F else {"nrc": answer[2]}


def test_every_service_is_answered_in_its_states_and_refused_in_others(layer, bench):
    """The file alone suffices: requests are encoded, states entered, and answers decoded to their last byte."""
    refusals = {Nrc.SERVICE_NOT_IN_SESSION, Nrc.SUB_FUNCTION_NOT_IN_SESSION, Nrc.OUT_OF_RANGE}
    assert len(layer.services) > 40
    for service in layer.services:
        name = service.short_name
        states = {ref.state.short_name for ref in service.pre_condition_state_refs}
        for session in Session:
            bench.ask(0x10, 1)
            bench.ask(0x10, session)
            if f"session_{session.name.lower()}" not in states:
                assert ask(bench, layer, name)["nrc"] in refusals, (name, session)
                continue
            for level in (level for level in Level if f"level_{level.name.lower()}" in states):
                assert ask(bench, layer, name) == {"nrc": Nrc.SECURITY_ACCESS_DENIED}, name
                bench.unlock(level)
            if name in ("transfer", "exit"):
                assert "nrc" not in ask(bench, layer, "download")
            if name == "exit":
                ask(bench, layer, "transfer")
            answer = ask(bench, layer, name)
            assert "nrc" not in answer, (name, session, answer)
            bench.wait(1)


def test_answers_mean_what_the_server_means(layer, bench):
    assert ask(bench, layer, "read_serial_number")["value"] == "Nr. 0815 µ"
    read = ask(bench, layer, "read_calibration_limits")["value"]
    assert read["greatest"] == pytest.approx(BY_NAME)
    assert ask(bench, layer, "read_capacity")["value"] == 0x05060708
    found = ask(bench, layer, "faults_by_status")["faults"]
    assert [(one["code"].display_trouble_code, one["status"]) for one in found] == [("U1101-87", 0x2F)]
    (moment,) = ask(bench, layer, "faults_snapshot")["snapshots"]
    assert (moment["time_ms_0"], moment["mode_before_0"], moment["missed_0"]) == (65535, Mode.CONTROL.name, 3)
    assert [moment[f"pressures_cp_{sensor}"] for sensor in range(4)] == [1.0, -0.5, 0.0, 0.25]
    assert len(ask(bench, layer, "faults_supported")["faults"]) == len(CODES)
    bench.unlock()
    assert ask(bench, layer, "routine_check")["verdict"] == Verdict.TOO_OLD.in_words
    request = layer.services.read_store.encode_request()
    (refused,) = layer.decode_response(b"\x7f\x22\x31", request)
    assert refused.param_dict["code"] == "out of range"


def test_it_has_all_that_the_tables_have_and_the_bus(layer):
    names = {service.short_name for service in layer.services}
    assert {f"read_{did.name.lower()}" for did in Did} | {f"routine_{one.name.lower()}" for one in Routine} <= names
    (codes,) = layer.diag_data_dictionary_spec.dtc_dops
    assert {dtc.trouble_code: dtc.display_trouble_code for dtc in codes.dtcs} == {
        code: in_letters(code) for code in CODES.values()
    }
    assert (layer.get_can_receive_id(), layer.get_can_send_id()) == (0x7E0, 0x7E8)
    rates = layer.get_can_baudrate(), layer.get_can_fd_baudrate(), layer.get_max_can_payload_size()
    assert rates == (500_000, 2_000_000, 64)
    classic = layer_of(BusConfig(frames="classic"))
    assert (classic.uses_can_fd(), classic.get_max_can_payload_size()) == (False, 8)
    assert "transmit" in layer.get_comparam("CP_UniqueRespIdTable").get_subvalue("CP_CanPhysReqFormat")
    assert layer.get_can_func_req_id() is None
    ids = DiagnosisConfig(request_id="0x18DA5AF1", response_id="0x18DAF15A", functional_id="0x18DB33F1")
    fixed = layer_of(BusConfig(diagnosis=ids))
    assert (fixed.get_can_receive_id(), fixed.get_can_send_id()) == (0x18DA5AF1, 0x18DAF15A)
    assert fixed.get_can_func_req_id() == 0x18DB33F1
    table = fixed.get_comparam("CP_UniqueRespIdTable")
    assert table.get_subvalue("CP_CanPhysReqFormat") == "normal segmented 29-bit transmit with FC"
    assert table.get_subvalue("CP_CanRespUSDTFormat") == "normal segmented 29-bit receive with FC"
    assert fixed.get_comparam("CP_CanFuncReqFormat").get_value() == "normal segmented 29-bit transmit with FC"
    assert pdx(BusConfig(), BECAUSE) == pdx(BusConfig(), BECAUSE)
    with zipfile.ZipFile(io.BytesIO(pdx(BusConfig(), BECAUSE))) as archive:
        catalogue = archive.read("index.xml").decode()
        assert all(f">{name}<" in catalogue for name in archive.namelist() if name != "index.xml")


@pytest.mark.filterwarnings("ignore:Coded constant parameter does not match")
def test_the_software_version_decides_the_ecu_variant(bench, monkeypatch):
    database = database_of(BusConfig())
    # In its strict mode the matcher takes an answer with another version for a malformed refusal.
    monkeypatch.setattr("odxtools.exceptions.strict_mode", False)
    for software, is_known in ((version("stillwake"), True), ("another", False)):
        bench.ecu.values[Did.SOFTWARE_VERSION] = software.encode()
        matcher = variantmatcher.VariantMatcher(list(database.ecu_variants), use_cache=False)
        for _, request in matcher.request_loop():
            matcher.evaluate(bench.ask(request))
        assert matcher.has_match() == is_known
    (variant,) = database.ecu_variants
    assert len(variant.services) == len(database.base_variants.stillwake_ecu.services)


@pytest.mark.parametrize("written", [intel_hex, s_records])
def test_a_tester_that_reads_nothing_but_these_files_flashes_a_release(written):
    """The flash sequence and its services from the PDX file, the image by another reader, keys by the JSON."""
    bincopy = pytest.importorskip("bincopy")
    file, database = bincopy.BinFile(), database_of(BusConfig())
    file.add(written(image("new")).decode())
    content, client = bytes(file.as_binary()), Client()
    assert file.minimum_address == 0
    assert content == image("new")
    (flash,) = database.flashs
    (connector,) = flash.ecu_mem_connectors
    (sequence, listed) = connector.session_descs[0].sdgs
    assert connector.layers[0] is database.ecu_variants[0]
    (data,) = connector.ecu_mem.mem.flashdatas
    assert (data.dataformat.selection.value, data.datafile.latebound_datafile) == ("INTEL-HEX", True)
    values: dict[str, Any] = {"LENGTH": len(content), "SHA256": hashlib.sha256(content).digest()}
    services, block = connector.layers[0].services, 0

    def asked(name: str, arguments: dict[str, Any]) -> dict[str, Any]:
        service = services[name]
        answer = client.ask(service.encode_request(**arguments))
        assert answer[0] != 0x7F, (name, answer.hex())
        return dict(service.decode_message(answer).param_dict)

    for step in sequence.values:
        name, *rest = [one.value for one in step.values]
        words = {one.semantic_info: one.value for one in step.values[1:]}
        assert {word for word in rest if word.isupper()} <= {one.semantic_info for one in listed.values}
        if name == "transfer":
            for number, at in enumerate(range(values["OFFSET"], len(content), block), start=1):
                asked(name, {"counter": number % 256, "data": content[at : at + block]})
            continue
        answer = asked(name, {key: values[word] if word.isupper() else int(word) for key, word in words.items()})
        if name == "seed_programming":
            values["KEY"] = key_by_json(bytes(answer["seed"]), "programming")
        elif name == "routine_erase":
            values |= {"OFFSET": answer["offset"], "REST": len(content) - answer["offset"]}
        elif name == "download":
            block = answer["block"] - 2
        elif name == "routine_check":
            assert answer["verdict"] == Verdict.GOOD.in_words
        elif name == "reset_hard":
            client.ecu.power_on()
    assert name_of(client.ecu.boot) == "new"
    assert client.ecu.routines[-2:] == [Routine.SELF_TEST, Routine.CONFIRM]


def key_by_json(seed: bytes, level: str, secret: bytes = SECRET) -> bytes:
    """By what the description says, and another implementation of AES-CMAC."""
    described = json.loads(seed_and_key())
    (number,) = (one["level"] for one in described["levels"] if one["name"] == level)
    label = bytes.fromhex(described["label_hex"]) + bytes([number])
    assert len(seed) == described["seed_bytes"]
    return cmac(cmac(secret, label), seed)


def test_known_answers_of_seed_and_key_are_those_of_another_implementation():
    for one in json.loads(seed_and_key())["levels"]:
        known = {name: bytes.fromhex(text) for name, text in one["known_answer"].items()}
        assert key_by_json(known["seed"], one["name"], known["access_key"]) == known["key"]
        assert one["request_seed"] == f"27 {Level[one['name'].upper()]:02X}"
