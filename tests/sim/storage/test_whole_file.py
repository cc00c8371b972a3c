import pytest

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
