"""Builds that the tests of the ECU in C share."""

import pytest

from tests.export.to_c.ecu.wire_parts import FRAMES, Parts, built, vehicle


@pytest.fixture(scope="session", params=FRAMES)
def parts(request, random_release, tmp_path_factory, shared_builds) -> Parts:
    """What faces the wire, with either set of messages."""
    folder = tmp_path_factory.mktemp(f"parts_{request.param}")
    return built(random_release, folder, vehicle(request.param), shared_builds.compile_c)
