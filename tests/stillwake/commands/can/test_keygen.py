import stat


def test_keygen_writes_a_key_once_and_never_shows_it(cli, tmp_path):
    path = tmp_path / "bus.key"
    made = cli("can", "keygen", path)
    assert (made.code, made.err) == (0, "")
    content = path.read_text()
    assert len(bytes.fromhex(content)) == 16
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert f"wrote {path}" in made.out
    assert f"--set bus.key={path}" in made.out and f"--access {path}" in made.out
    assert content.strip() not in made.out

    again = cli("can", "keygen", path)
    assert again.code == 1
    assert again.err == f"error: {path}: exists already; a key is never overwritten\n"
    assert path.read_text() == content


def test_a_run_refuses_what_is_no_key_in_one_line(cli, tmp_path):
    path = tmp_path / "bus.key"
    path.write_text("not a key of 32 hexadecimal digits")
    path.chmod(0o600)
    found = cli("run", tmp_path / "run", "--set", f"bus.key={path}")
    assert found.code == 1
    assert found.err.startswith(f"error: {path}: not a key; must have 16 bytes, or 32 hexadecimal digits")
    assert not (tmp_path / "run").exists()
