"""A build of the tests is that of the compiler, whatever was kept of the builds before it."""

import subprocess

import pytest

from contract.errors import LibraryError
from ecu.in_c.compiler import host_compiler
from tests.c_builds import SharedBuilds, needed

FILES = {
    "main.c": b'#include "one.h"\n#include <stdio.h>\nint main(void) { printf("%d", one() + TWO); return 0; }\n',
    "one.c": b'#include "one.h"\nint one(void) { return 1; }\n',
    "one.h": b'#include "two.h"\nint one(void);\n',
    "two.h": b"#define TWO 2\n",
    "other.c": b"int other(void);\nint other(void) { return 0; }\n",
}


@pytest.mark.compiler
def test_what_has_changed_is_compiled_and_nothing_else(tmp_path):
    builds = SharedBuilds(tmp_path / "kept")

    def printed(changes: dict[str, bytes]) -> tuple[str, int]:
        builds.compile_c(FILES | changes, tmp_path / "program", compiler=host_compiler(), flags=("-O0",))
        done = subprocess.run([tmp_path / "program"], capture_output=True, text=True, check=True)
        return done.stdout, len(list((tmp_path / "kept").glob("*.o")))

    assert printed({}) == ("3", 3)
    assert printed({"one.c": FILES["one.c"].replace(b"1", b"5")}) == ("7", 4)
    assert printed({"two.h": b"#define TWO 9\n"}) == ("10", 6)
    # A warning is an error, of which the compiler's own line is left.
    with pytest.raises(LibraryError, match=r"one\.c.*unused"):
        printed({"one.c": b"int one(void);\nint one(void) { int x; return 1; }\n"})
    assert needed(FILES, "other.c").keys() == {"other.c"}
    assert needed(FILES | {"other.c": b"#include TWO\n"}, "other.c").keys() == FILES.keys()
