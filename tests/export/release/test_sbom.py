"""Bills of materials: as the standard's schema has them, complete, and the same again."""

import hashlib
import json
import zipfile
from importlib.metadata import version
from importlib.resources import files

import pytest
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

from contract.errors import BundleError
from contract.release.bundle import load
from contract.release.container import read_files
from contract.shipped import BUNDLE
from ecu.c.sources import loader_sources
from export.release.sbom import folder_bom, release_bom, wheel_bom, write_bom


@pytest.fixture(scope="module")
def checked():
    validator = JsonStrictValidator(SchemaVersion.V1_6)

    def parsed(content: bytes):
        assert validator.validate_str(content.decode()) is None
        return json.loads(content)

    return parsed


def hashes(bom) -> dict[str, str]:
    return {item["name"]: item["hashes"][0]["content"] for item in bom["components"] if "hashes" in item}


def test_a_releases_bill_has_every_file_what_it_was_trained_on_and_the_tools(checked, random_release, tmp_path):
    bundle, contents = load(BUNDLE), read_files(BUNDLE)
    bom, manifest = checked(content := release_bom(bundle, contents)), bundle.manifest
    assert content == release_bom(bundle, dict(reversed(contents.items())))
    sums = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in BUNDLE.iterdir()}
    origin = {"weights": manifest.weights_sha256, "dataset": manifest.dataset_sha256}
    assert sums.items() | origin.items() <= hashes(bom).items()
    stated = {item["name"]: item.get("version") for item in bom["components"]}
    assert manifest.provenance["versions"].items() <= stated.items()
    assert bom["metadata"]["timestamp"].startswith(manifest.created)
    depends = {item["ref"]: item.get("dependsOn", []) for item in bom["dependencies"]}
    assert depends["controller.onnx"] == ["weights"]
    assert {"dataset", "torch"} <= set(depends["weights"])
    assert bom["metadata"]["component"]["licenses"] == [{"license": {"id": "MIT"}}]
    other = checked(release_bom(load(random_release), read_files(random_release)))
    assert "licenses" not in other["metadata"]["component"]  # not the project's
    assert other["serialNumber"] != bom["serialNumber"]
    assert write_bom(tmp_path / "b.zip", content).name == "b.zip.cdx.json"
    object.__setattr__(manifest, "name", "numpy")  # as a package of its own bill
    assert release_bom(bundle, contents) == release_bom(bundle, contents)
    for versions in (["numpy"], {"numpy": 2}, {"": "2"}, None):
        object.__setattr__(manifest, "provenance", {"versions": versions})
        with pytest.raises(BundleError, match="versions must be a table"):
            release_bom(bundle, contents)


def test_the_bill_of_a_c_folder_has_every_file_the_release_and_the_code_of_others(checked):
    contents = {f"loader/{name}": text for name, text in loader_sources().items()} | {"sw_ecu.c": b"int a;\n"}
    content, bundle = folder_bom(contents, load(BUNDLE)), load(BUNDLE)
    assert content == folder_bom(dict(reversed(contents.items())), bundle)
    bom = checked(content)
    assert {name: hashlib.sha256(text).hexdigest() for name, text in contents.items()} == hashes(bom)
    parts = {item["name"]: item for item in bom["components"]}
    assert parts[bundle.manifest.name]["version"] == bundle.digest[:12]
    monocypher = parts["monocypher"]
    assert monocypher["licenses"] == [{"expression": "BSD-2-Clause OR CC0-1.0"}]
    assert monocypher["purl"] == "pkg:github/loupvaillant/monocypher@4.0.3" and monocypher["version"] == "4.0.3"
    assert "Monocypher 4.0.3, unchanged" in files("ecu").joinpath("c/store/vendor/README.md").read_text()
    assert all(b"__git__" not in text for text in contents.values())
    depends = {item["ref"]: item.get("dependsOn", []) for item in bom["dependencies"]}
    assert depends["monocypher"] == [f"loader/monocypher{end}" for end in ("-ed25519.h", "-ed25519_c.h", ".h", "_c.h")]
    assert {"monocypher", "sw_ecu.c", f"release {bundle.manifest.name}"} <= set(depends[f"{bundle.manifest.name} in C"])
    bare = checked(folder_bom({"sw_ecu.c": b""}, bundle))
    assert {item["name"] for item in bare["components"]} == {bundle.manifest.name, "sw_ecu.c"}


def test_a_wheels_bill_has_what_it_requires_and_what_extras_do(checked, tmp_path):
    path = tmp_path / "thing-1.0-py3-none-any.whl"
    requires = ("numpy>=2.0", 'numpy>=2; extra == "more"', 'onnx>=1; extra == "more"', 'absent>=1; extra == "more"',
                'thing[more]; extra == "all"')  # fmt: skip
    lines = ("Metadata-Version: 2.4", "Name: thing", "Version: 1.0", "License-Expression: MIT",
             *(f"Requires-Dist: {text}" for text in requires))  # fmt: skip
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("thing-1.0.dist-info/METADATA", "\n".join(lines))
    bom = checked(content := wheel_bom(path, "2026-11-26"))
    assert content == wheel_bom(path, "2026-11-26")
    found = {item["name"]: (item["scope"], item.get("version")) for item in bom["components"]}
    extras = {"onnx": ("optional", version("onnx")), "absent": ("optional", None)}
    assert found == {"numpy": ("required", version("numpy")), **extras}
    assert bom["metadata"]["component"]["hashes"][0]["content"] == hashlib.sha256(path.read_bytes()).hexdigest()
