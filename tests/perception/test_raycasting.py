"""Open3D without a library of the system."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from perception import raycasting


def test_a_missing_library_is_named_with_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "open3d"
    broken.mkdir()
    (broken / "__init__.py").write_text("raise OSError('libnosuch.so.9: cannot open shared object file')\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "open3d", raising=False)
    monkeypatch.setitem(raycasting.LIBRARIES, "libnosuch.so.9", "libnosuch9")
    with pytest.raises(OSError, match=r"cannot load libnosuch\.so\.9: sudo apt-get install -y libnosuch9$"):
        raycasting.load_open3d()
    monkeypatch.delitem(raycasting.LIBRARIES, "libnosuch.so.9")
    with pytest.raises(OSError, match=r"Open3D cannot be loaded: libnosuch\.so\.9: cannot open shared object file"):
        raycasting.load_open3d()
