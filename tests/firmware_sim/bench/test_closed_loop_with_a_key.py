"""`bus.key` alone closes the loop over authenticated frames, and the key stays where it is."""

import json
import secrets

import can
import numpy as np
import pytest
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.cmac import CMAC

from can_bridge.secoc.key import write_key
from can_bridge.wire.messages import Mode
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.release import bundle
from firmware_sim.bench.closed_loop import run_closed_loop
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_page.report import write_report

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_pictures")]  # whole runs of the loop

PERIODS = 20


def run(folder, release, key: str):
    return run_closed_loop(
        folder,
        release,
        Config(bus=BusConfig(key=key)),
        lead_in=2.0,
        controlled=0.2 * (PERIODS - 10),
        settle=0.0,
        averages=False,
    )


def test_one_setting_authenticates_both_nodes(short_release, tmp_path):
    release = bundle.load(short_release)
    secret = secrets.token_bytes(16)
    write_key(tmp_path / "key", secret)
    folder = tmp_path / "run"
    log = run(folder, release, str(tmp_path / "key"))
    write_report(RunFolder(folder))
    plain = run(tmp_path / "plain", release, "")

    assert set(log.series["mode"][-5:]) == {Mode.CONTROL}
    # Frames are longer by less than a time step of the flow: the wake and the jets are the same to the bit.
    for name in ("Cd", "Cl", "action", "command", "mode", "reason"):
        np.testing.assert_array_equal(log.series[name], plain.series[name], err_msg=name)
    assert (log.bus.lost, log.bus.rejected, log.metadata.status.not_authentic) == (0, 0, 0)
    with can.CanutilsLogReader(folder / "frames.log") as reader:
        messages = list(reader)
    assert [message.arbitration_id for message in messages] == [0x122, 0x132, 0x142] * PERIODS
    data_ids = {0x122: 0x5704, 0x132: 0x5705, 0x142: 0x5706}
    for number, message in enumerate(messages):
        data = bytes(message.data)
        # Both nodes are in their first power cycle.
        assert int.from_bytes(data[-16:-8], "big") == (1 << 32) + number // 3
        mac = CMAC(AES(secret))
        mac.update(data_ids[message.arbitration_id].to_bytes(2, "big") + data[:-8])
        assert data[-8:] == mac.finalize()[:8]

    settings = json.loads((folder / "summary.json").read_text())["settings"]
    assert settings["bus"]["key"] == str(tmp_path / "key")
    for path in folder.iterdir():
        content = path.read_bytes()
        assert secret not in content, path
        assert secret.hex().encode() not in content.lower(), path
    assert sorted(path.name for path in tmp_path.iterdir()) == ["key", "plain", "run"]
