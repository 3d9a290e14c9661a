"""The ECU in C as an export writes it: what it is made of, and what it says it goes without."""

from dataclasses import replace

import numpy as np

from contract.config.tree import Config
from contract.controller.c_folder import ECU_SETTINGS
from contract.release.bundle import load
from contract.shipped import BUNDLE
from stillwake.parts import c_release
from stillwake.parts.c_release import ecu_files

ROWS = np.zeros((10, 5))


def test_an_ecu_checks_no_sensors_without_an_estimator_or_int8_and_says_so(random_release):
    """The shipped release has an estimator, and says that it is int8."""
    lines: list[str] = []
    found = ecu_files(load(random_release), ROWS, config=Config(), notice=lines.append)
    assert b"#define SW_SENSOR_CHECK 0\n" in found[ECU_SETTINGS]
    release = load(BUNDLE)
    assert c_release._without_check(release, Config(), lines.append) == Config()
    object.__setattr__(release.manifest, "precision", "float32")
    assert not c_release._without_check(release, Config(), lines.append).ecu.sensor_check.enabled
    assert ["does not check the sensors" in line for line in lines] == [True, True]
    assert "--precision int8" in lines[1]


def test_what_c_cannot_do_leaves_the_control_step_alone_and_is_said(random_release):
    lines: list[str] = []
    other = replace(Config(), operating_point=replace(Config().operating_point, width=2.6))
    assert ecu_files(load(random_release), ROWS, config=other, notice=lines.append) == {}
    assert "no ECU in C" in lines[-1]
    assert "operating point" in lines[-1]
