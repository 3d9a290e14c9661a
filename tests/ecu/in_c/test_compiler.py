"""Compilers: which one is taken, and what is reported of one that is missing or complains."""

import importlib.util
import shutil

import pytest

from contract.errors import LibraryError
from ecu.in_c.compiler import compile_c, compiler_version, host_compiler, zig_compiler


def test_the_environment_comes_first_and_without_any_the_error_names_the_remedy(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setenv("CC", "ccache gcc-14")
    assert host_compiler() == ["ccache", "gcc-14"]
    monkeypatch.setenv("CC", "  ")
    with pytest.raises(LibraryError, match="no C compiler: install gcc or clang"):
        host_compiler()


def test_a_complaint_is_quoted_and_a_compiler_that_is_missing_is_named(tmp_path, monkeypatch):
    monkeypatch.delenv("CC", raising=False)
    compiler = host_compiler()
    assert compiler_version(compiler)
    with pytest.raises(LibraryError, match="error"):
        compile_c({"a.c": b"int main(void) { return x; }"}, tmp_path / "a", compiler=compiler, flags=())
    with pytest.raises(LibraryError, match="/nowhere/gcc: No such file"):
        compile_c({}, tmp_path / "a", compiler=["/nowhere/gcc"], flags=())


@pytest.mark.skipif(zig_compiler() is None, reason="ziglang is not installed (extra mcu)")
def test_ziglang_compiles_without_a_home(tmp_path, monkeypatch):
    for name in ("HOME", "XDG_CACHE_HOME", "ZIG_GLOBAL_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    source = b"int answer(void);\nint answer(void) { return 42; }\n"
    compile_c({"a.c": source}, tmp_path / "a.o", compiler=zig_compiler() or [], flags=("-c",))
    assert (tmp_path / "a.o").exists()
