import os
import stat

import pytest

from adaptsim_cli.storage import durable
from sim.storage.files import read_toml, sha256, whole_file, write_toml


def test_a_file_appears_whole(tmp_path):
    path = tmp_path / "deep" / "a.toml"
    write_toml(path, {"x": 1, "y": [0.5, 1.5]})
    assert read_toml(path) == {"x": 1, "y": [0.5, 1.5]}
    assert len(sha256(path)) == 64
    assert [p.name for p in path.parent.iterdir()] == ["a.toml"]


def test_an_error_leaves_the_old_file_and_nothing_beside_it(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(RuntimeError), whole_file(path) as temporary:
        temporary.write_text("half of the n")
        raise RuntimeError("power cut")
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.parametrize(("umask", "mode"), [(0o002, 0o664), (0o022, 0o644), (0o077, 0o600)])
def test_a_file_has_the_permissions_that_the_umask_leaves(tmp_path, umask, mode):
    """A second operator of a group continues the first one's sessions with umask 002."""
    before = os.umask(umask)
    try:
        with whole_file(tmp_path / "a") as temporary:
            temporary.write_bytes(b"x")
        durable.write_folder(tmp_path / "folder", {"b": b"y"})
        with durable.locked(tmp_path / "folder", ""):
            pass
    finally:
        os.umask(before)
    files = (tmp_path / "a", tmp_path / "folder/b", tmp_path / "folder/.lock")
    assert [stat.S_IMODE(path.stat().st_mode) for path in files] == [mode] * 3
    assert stat.S_IMODE((tmp_path / "folder").stat().st_mode) == 0o777 & ~umask
