"""The package: README as an index shows it, the two lists of exact versions, and the wheel outside of the checkout."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from importlib import metadata
from types import ModuleType

import pytest
from documents import ROOT, module
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

URL = "https://git.example/lab/adaptsim"
TARGET = re.compile(r"\]\(([^)\s]+)\)")


@pytest.fixture(scope="module")
def setup() -> ModuleType:
    return module(ROOT / "setup.py")


def test_every_link_is_absolute_and_leads_to_a_file(setup):
    text = setup.readme((ROOT / "README.md").read_text(encoding="utf-8"), URL)
    targets = TARGET.findall(text)
    assert len(targets) > 20
    for target in targets:
        assert re.match(r"https?://", target), target
        if target.startswith(URL):
            path = re.fullmatch(rf"{URL}/(?:blob|raw)/main/([^#]*)(?:#.*)?", target)
            assert path is not None and (ROOT / path[1]).is_file(), target


def test_pictures_are_raw_files_and_pages_are_not(setup):
    text = setup.readme("![a](docs/figures/loop.svg) [b](docs/README.md#start) [c](https://arxiv.org/x)", URL)
    picture, page, paper = TARGET.findall(text)
    assert picture == f"{URL}/raw/main/docs/figures/loop.svg"
    assert page == f"{URL}/blob/main/docs/README.md#start"
    assert paper == "https://arxiv.org/x"


def test_without_a_repository_links_keep_their_words(setup):
    assert (
        setup.readme("![a](x.png)see [b](docs/README.md), [c](https://arxiv.org/x)", "")
        == "see b, [c](https://arxiv.org/x)"
    )
    assert setup.urls("") == {"Paper": setup.PAPER}
    assert setup.urls(URL)["Issues"] == f"{URL}/issues"


def test_the_readme_has_a_picture_that_is_small():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    first = re.search(r"!\[[^\]]+\]\((\S+\.(?:png|jpg|webp))\)", text)
    assert (ROOT / first[1]).stat().st_size < 400_000
    assert text.index(first[0]) < 100


def locked(name: str) -> dict[str, str]:
    lines = (ROOT / name).read_text().splitlines()
    packages = [(line, Requirement(line)) for line in lines if not line.startswith("#")]
    return {canonicalize_name(one.name): line for line, one in packages if one.marker is None or one.marker.evaluate()}


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CUDA = ("cuda-", "nvidia-", "triton")
"""How the packages begin that PyTorch asks for where there is no CPU build of it."""


def needed(wanted: list[str]) -> set[str]:
    """Names of packages, and of what they need in turn, as their installed metadata say; without what we leave out."""
    left_out = set(PROJECT["tool"]["uv"]["exclude-dependencies"])
    names, todo = set[str](), [Requirement(text) for text in wanted]
    while todo:
        one = todo.pop()
        name = canonicalize_name(one.name)
        if name in names | left_out or name.startswith(CUDA):
            continue
        if one.marker is not None and not one.marker.evaluate({"extra": ""}):
            continue
        names.add(name)
        todo += [Requirement(text) for text in metadata.requires(name) or []]
    return names


def test_what_the_program_runs_with_is_a_part_of_everything():
    run, everything = locked("requirements-run.lock"), locked("requirements.lock")
    assert run.items() <= everything.items()
    assert not run.keys() & {"mujoco", "pin", "sbi", "botorch", "pytest", "mypy", "ruff", "distributed", "torch"}


LOCKED_IMPORTS = """
import importlib, sys
for name in sys.argv[1:]:
    importlib.import_module(name)
"""


@pytest.mark.parametrize(
    ("described", "version"),
    [
        ("v0.2.0", "0.2.0"),
        ("0.2.0.dev0", "0.2.0.dev0"),
        ("v0.2.0-5-gc4d264db", "0.2.0.post5+gc4d264db"),
        ("c4d264db", "0.0.0+gc4d264db"),
        ("1234567", "0.0.0+g1234567"),
        ("main-dirty", "0.0.0+gmain.dirty"),
        ("", "0.0.0"),
    ],
)
def test_the_version_of_a_build_without_git_always_parses(setup, described, version):
    assert setup.version_of(described) == version
    assert str(Version(version)) == version


@pytest.mark.long
def test_every_package_that_the_program_runs_with_imports_plainly():
    """Open3D's module, for example, needs plotly and dash as soon as a user imports it."""
    run = locked("requirements-run.lock").keys()
    modules = {
        module
        for module, owners in metadata.packages_distributions().items()
        if module.isidentifier() and not module.startswith("_") and {*map(canonicalize_name, owners)} <= run
    }
    assert {"open3d", "pydrake", "cv2", "plotly", "dash"} <= modules
    line = [sys.executable, "-c", LOCKED_IMPORTS, *sorted(modules)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.parametrize("name", ["requirements.lock", "requirements-run.lock"])
@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
def test_a_list_has_one_version_of_each_package_for_each_python(name, python):
    here = {"python_version": python, "python_full_version": f"{python}.1", "sys_platform": "linux"}
    lines = [line for line in (ROOT / name).read_text().splitlines() if not line.startswith("#")]
    there = [one for one in map(Requirement, lines) if one.marker is None or one.marker.evaluate(here)]
    names = [canonicalize_name(one.name) for one in there]
    assert len(names) == len(set(names))
    assert all(str(one.specifier).startswith("==") for one in there)
    drake = {str(one.specifier) for one in there if one.name == "drake"}
    assert drake == ({"==1.51.1"} if python == "3.11" else {"==1.58.0"})
    asked = {one.name: one for one in map(Requirement, PROJECT["project"]["dependencies"])}
    for one in there:
        if one.name in asked and asked[one.name].marker is None:
            assert asked[one.name].specifier.contains(str(one.specifier).removeprefix("=="))


def test_what_comes_before_a_release_sorts_before_it():
    fallback = Version(PROJECT["tool"]["setuptools_scm"]["fallback_version"])
    (coming,) = re.findall(r"^## (\S+) – not yet released", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert fallback.is_devrelease
    assert fallback < Version(coming) == Version(fallback.base_version)


def test_every_action_of_a_workflow_is_pinned_by_its_commit():
    workflows = sorted((ROOT / ".github/workflows").glob("*.yml"))
    used = [line for file in workflows for line in re.findall(r"uses: (.*)", file.read_text())]
    assert len(workflows) == 3
    assert len(used) > 10
    assert [line for line in used if not re.fullmatch(r"[\w./-]+@[0-9a-f]{40}  # v[\d.]+", line)] == []


def test_the_image_holds_every_package_and_module_of_the_program():
    """The build in the image sees these files alone; a module that is not there is missing from its wheel."""
    lines = re.findall(r"^COPY (.*)$", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    copied = {word for line in lines for word in line.split()[:-1]}
    packages = {name.rstrip("*") for name in PROJECT["tool"]["setuptools"]["packages"]["find"]["include"]}
    modules = {f"{name}.py" for name in PROJECT["tool"]["setuptools"]["py-modules"]}
    assert {*packages, *modules, "pyproject.toml", "setup.py", "README.md"} <= copied


def test_it_holds_all_that_the_program_needs():
    wanted = PROJECT["project"]["dependencies"]
    assert needed(wanted) <= locked("requirements-run.lock").keys()


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_wheel_works_outside_of_the_checkout():
    env = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(["make", "package"], cwd=ROOT, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    said = done.stdout + done.stderr
    assert "Next: adaptsim run-iteration" in said
    assert "Report: " in said
    assert str(ROOT / "build/package/home") in said.replace("\n", "")
    (wheel,) = (ROOT / "build/package").glob("adaptsim-*.whl")
    assert wheel.stat().st_size < 30_000_000
