"""Somebody's own `sim/` and `hw.py` lie in the way: ours are found all the same, in every process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NAMES = ("sim", "hw", "perception", "calib")
SCRIPT = """
from adaptsim_cli import api
import sim.rollouts, hw.workcell, perception.types, calib.types
from sim.rollouts.executors import process_pool
from hw.computer import usable_cores

if __name__ == "__main__":
    print(sim.rollouts.__file__)
    with process_pool(1) as pool:
        print(pool.submit(usable_cores).result() > 0)
"""


@pytest.fixture(params=["folders", "files"])
def strange(request, tmp_path: Path) -> Path:
    """A folder with four packages or four modules of our names, each of which ends the program that imports it."""
    for name in NAMES:
        file = tmp_path / (f"{name}/__init__.py" if request.param == "folders" else f"{name}.py")
        file.parent.mkdir(exist_ok=True)
        file.write_text(f"raise SystemExit('a strange {name}')")
    return tmp_path


def run(*arguments: str, cwd: Path, path: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Our packages count as installed because the installation's path comes after all others."""
    home = {"ADAPTSIM_HOME": str(cwd / "home"), "PYTHONPATH": os.pathsep.join(map(str, (path, ROOT)))}
    command = (sys.executable, *arguments)
    return subprocess.run(command, cwd=cwd, env={**os.environ, **home}, capture_output=True, text=True, check=False)


@pytest.mark.long
@pytest.mark.parametrize("stored", [False, True])
def test_a_script_beside_them_and_its_pool_of_processes(strange: Path, stored: bool) -> None:
    """A worker imports a stored script before its work; one that is not a file, as in a notebook, is unknown to it."""
    (strange / "study.py").write_text(SCRIPT)
    done = run(*(("study.py",) if stored else ("-c", SCRIPT)), cwd=strange)
    assert done.stdout.splitlines() == [str(ROOT / "sim" / "rollouts" / "__init__.py"), "True"], done.stderr


def test_the_program_with_them_in_the_current_folder(strange: Path) -> None:
    done = run("-m", "adaptsim_cli", "config", "path", cwd=strange)
    assert done.returncode == 0, done.stderr
    assert str(strange / "home") in done.stdout


def test_the_program_and_a_child_of_ours_with_them_on_the_path_of_python(strange: Path, tmp_path_factory) -> None:
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    looks = "import adaptsim_cli; from hw.camera.probe import probe_realsense; print(probe_realsense().error)"
    done = run("-c", looks, cwd=elsewhere, path=strange)
    assert done.returncode == 0, done.stderr
    assert "ended its process" not in done.stdout


def test_one_sentence_names_a_package_that_was_imported_before_ours(tmp_path: Path) -> None:
    (tmp_path / "sim").mkdir()
    (tmp_path / "sim" / "__init__.py").write_text("")
    done = run("-c", "import sim, adaptsim_cli", cwd=tmp_path)
    assert done.stderr.splitlines()[-1] == (
        f"ImportError: adaptsim cannot import its own package 'sim', because {tmp_path / 'sim'} was imported under "
        "that name before: rename sim, or import adaptsim_cli before it (then `import sim` gives adaptsim's package "
        "everywhere)"
    )


def test_the_sentence_names_a_file_too_and_nothing_of_ours_is_loaded(tmp_path: Path) -> None:
    (tmp_path / "hw.py").write_text("")
    attempt = "try: import adaptsim_cli\nexcept ImportError as error: print(error, 'sim' in sys.modules)"
    done = run("-c", f"import sys, hw\n{attempt}", cwd=tmp_path)
    assert str(tmp_path / "hw.py") in done.stdout
    assert "rename hw.py" in done.stdout
    assert done.stdout.endswith("False\n")
