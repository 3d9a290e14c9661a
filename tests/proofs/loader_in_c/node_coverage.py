"""Branches of diagnosis in C that random testers take, by gcc and gcovr."""

from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Final

from tests.proofs.ecu_in_c.branch_coverage import branches
from tests.proofs.loader_in_c.node_library import QUICK, Library, build, sources
from tests.proofs.loader_in_c.node_program import play
from tests.proofs.loader_in_c.node_slow import beside_jets, erased_beside, with_few_places
from tests.proofs.loader_in_c.node_twin import CONFIGS, world

FILES: Final = (
    *("sw_access.c", "sw_calibrating.c", "sw_isotp.c", "sw_node.c", "sw_programming.c", "sw_services.c", "sw_uds.c"),
)
UNREACHED: Final = {
    ("sw_access.c", "level, 0) != SW_STORE_DONE"): "the memory would have to fail between two records of one call",
    ("sw_isotp.c", "frame->length > SW_FRAME_BYTES"): "no CAN controller gives such a frame; the fuzzer does",
    ("sw_isotp.c", "if (end->queue.count == SW_ISOTP_QUEUE || length > room)"): "no request is begun without a place",
    ("sw_node.c", "sw_image_open(image, &numbers) == SW_IMAGE_OK"): "the boot judged the build before",
    ("sw_node.c", "sw_store_read_image(store"): "the memory would have to fail behind the judgement of the boot",
    ("sw_node.c", "if (now_ns < 0) return 0;"): "no clock here begins before 0; the fuzzer's does",
}
"""Branches that nothing leads to, by the text of their line, and why they stand there all the same."""


def missed(folder: Path, seeds: Sequence[int], requests: int = 60) -> list[str]:
    """Branches of `FILES` that programs of these seeds do not take, `file:line: text`, and those of `UNREACHED` that
    they do."""
    found = dict[str, int]()
    for kind, config in CONFIGS.items():
        place, contents = folder / kind, sources(config)
        library = Library(contents, build(contents, place, f"{kind}.so", (*QUICK, "--coverage", "-DHOST_COVERAGE")))
        of = world(kind, library)
        for seed in seeds:
            assert play(of, seed, requests, trouble=(0.001, 0.02, 0.1)[seed % 3]).differences == []
        erased_beside(of)
        with_few_places(of)
        beside_jets(of)
        library.c.host_dump()
        for file, at, counts in branches(place):
            if file in FILES:
                for number, taken in enumerate(counts):
                    name = f"{file}:{at} #{number}"
                    found[name] = found.get(name, 0) + taken
    assert found, "gcovr found no branch"
    never = [name for name, count in found.items() if count == 0]
    named = {key: [name for name in never if name.startswith(key[0]) and key[1] in name] for key in UNREACHED}
    return [
        *(set(never) - {*chain(*named.values())}),
        *(f"{key} is taken" for key, names in named.items() if not names),
    ]
