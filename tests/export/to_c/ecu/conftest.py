"""Builds that the tests of the ECU in C share."""

import pytest

from tests.export.to_c.ecu import core_parts
from tests.export.to_c.ecu.wire_parts import FRAMES, Parts, built, vehicle


@pytest.fixture(scope="session", params=FRAMES)
def parts(request, random_release, tmp_path_factory, shared_builds) -> Parts:
    """What faces the wire, with either set of messages."""
    folder = tmp_path_factory.mktemp(f"parts_{request.param}")
    return built(random_release, folder, vehicle(request.param), shared_builds.compile_c)


@pytest.fixture(scope="session", params=core_parts.VEHICLES)
def core(request, random_release, tmp_path_factory, shared_builds) -> Parts:
    """What decides: timing, fail-safe, gate and memory, for vehicles with settings far apart."""
    folder = tmp_path_factory.mktemp(f"core_{request.param}")
    config = core_parts.VEHICLES[request.param]
    return built(random_release, folder, config, shared_builds.compile_c, core_parts.SOURCES)
