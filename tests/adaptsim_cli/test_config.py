from __future__ import annotations

import re
from pathlib import Path

import pytest

from adaptsim_cli import config
from adaptsim_cli.errors import UsageError


@pytest.fixture
def home(tmp_path) -> Path:
    (tmp_path / "home").mkdir()
    return tmp_path / "home"


@pytest.fixture
def project(tmp_path) -> Path:
    (tmp_path / "project").mkdir()
    return tmp_path / "project"


def load(home: Path, project: Path, flags: dict[str, object] | None = None, **env: str) -> config.Resolved:
    return config.load(flags, {"ADAPTSIM_HOME": str(home), "HOME": "/nowhere", **env}, project)


def test_flag_over_environment_over_project_over_user_over_default(home, project):
    (home / "config.toml").write_text("seed = 1\nworld = 'a'\nmethod = 'm'\nworkers = 1\n")
    (project / "adaptsim.toml").write_text("seed = 2\nworld = 'b'\nmethod = 'n'\n")
    found = load(home, project, {"seed": 4, "world": None}, ADAPTSIM_SEED="3", ADAPTSIM_WORLD="c")
    assert (found.config.seed, found.config.world, found.config.method, found.config.workers) == (4, "c", "n", 1)
    assert found.config.particles == 2
    assert found.sources["seed"] == "flag"
    assert found.sources["world"] == "ADAPTSIM_WORLD"
    assert found.sources["method"] == str(project / "adaptsim.toml")
    assert found.sources["workers"] == str(home / "config.toml")
    assert found.sources["particles"] == "default"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("sead = 1", r"adaptsim.toml: unknown key 'sead', did you mean 'seed'\? Known keys: hw, rig"),
        ("seed = -1", r"seed = -1: it must be greater than or equal to 0"),
        ("seed = '0'", r"seed = '0': it must be a valid integer"),
        ("min_free_mb = '1 GB'", r"min_free_mb = '1 GB': .*free disk space that a session needs, MB"),
        ("hw = 'ur5'", r"hw = 'ur5': choose one of fake, panda, fr3"),
        ("seed = ", r"adaptsim.toml is not valid TOML: Invalid value"),
        ("[run]\nseed = 1", r"unknown key 'run'; Known keys"),
        ("particles = 99", r"less than or equal to 16"),
    ],
)
def test_a_bad_file_is_refused_naming_file_key_and_remedy(home, project, text, told):
    (project / "adaptsim.toml").write_text(text)
    with pytest.raises(UsageError, match=told) as caught:
        load(home, project)
    assert str(project) in str(caught.value)


def test_a_bad_environment_variable_is_refused(home, project):
    with pytest.raises(UsageError, match=r"environment: seed = 'many'"):
        load(home, project, ADAPTSIM_SEED="many")
    with pytest.raises(UsageError, match="unknown key 'wrld', did you mean 'world'"):
        load(home, project, ADAPTSIM_WRLD="wd")


def test_every_documented_variable_may_be_set(tmp_path):
    root = Path(__file__).parents[2]
    pages = (*root.glob("*.md"), *(root / "docs").rglob("*.md"))
    ours = set(re.findall(r"ADAPTSIM_[A-Z0-9_]*[A-Z0-9]", "".join(page.read_text() for page in pages)))
    assert {"ADAPTSIM_KINECT_RECORDING", "ADAPTSIM_K4ARECORD_LIBRARY", "ADAPTSIM_TEST_FR3", "ADAPTSIM_HOME"} <= ours
    settings = {f"ADAPTSIM_{key.upper()}" for key in config.load({}, {}, tmp_path).sources}
    config.load({}, dict.fromkeys(ours - settings, "/nowhere"), tmp_path)


def test_adaptsim_home_moves_data_and_settings(home: Path, project: Path) -> None:
    assert load(home, project).places.sessions == home / "data" / "sessions"


def test_the_next_command_names_task_and_object():
    assert config.Config(task="pushing").same_task == "--task pushing"
    assert config.Config(object="my food.toml").same_task == "--task scooping --object 'my food.toml'"
