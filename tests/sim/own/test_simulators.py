"""Scenes of MuJoCo and Drake, environments of gymnasium and programs: parameters by name, and helpful refusals."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import adaptsim
from sim.own.values import Values

SCENE = str(Path(__file__).parents[2] / "data/own_simulator/scene.xml")


def p(**values):
    return Values("p", values)


@pytest.fixture
def mujoco():
    return pytest.importorskip("mujoco")


def test_a_scene_gets_its_parameters_by_name_and_keeps_nothing(mujoco):
    scene = adaptsim.mjcf(SCENE, {"mu": "geom/table/friction[0]", "mass": "geom/puck/mass", "g": "opt/gravity[2]"})
    model = scene(p(mu=0.2, mass=0.4, g=-1.6))
    assert model.geom("table").friction[0] == 0.2
    assert model.body("puck").mass[0] == pytest.approx(0.4)
    assert model.opt.gravity[2] == -1.6
    model.body("cue").pos[:] = 9.0
    assert scene(p(mu=0.1, mass=0.1, g=-1.6)).body("cue").pos[0] == -0.05


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("geom/tabel/friction[0]", r"there is no geom 'tabel'; there is puck, rail, table, tip; did you mean table\?"),
        ("geom/table/frikcion[0]", r"there is no attribute 'frikcion'; there is .*friction.*did you mean friction"),
        ("geom/table/friction", r"friction has 3 numbers: choose one, as friction\[0\]"),
        ("geom/table/friction[3]", r"friction has 3 numbers, so the last is \[2\]"),
        ("geon/table/friction[0]", r"there is no kind 'geon'; there is .*geom"),
        ("friction", r"a path is kind/name/attribute, as geom/table/friction\[0\]"),
    ],
)
def test_a_wrong_path_of_a_scene_names_what_there_is(mujoco, path, words):
    with pytest.raises(adaptsim.TaskError, match=rf"scene.xml: mu = '.*': {words}"):
        adaptsim.mjcf(SCENE, {"mu": path})


def test_a_scene_that_is_missing_or_broken_is_said(mujoco, tmp_path):
    with pytest.raises(adaptsim.TaskError, match=r"there is no file .*nowhere.xml: a relative path is relative"):
        adaptsim.mjcf("nowhere.xml", {})
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody>")
    with pytest.raises(adaptsim.TaskError, match=r"broken.xml is not a scene of MuJoCo"):
        adaptsim.mjcf(str(tmp_path / "broken.xml"), {})


def test_a_rollout_of_a_scene_sees_the_present_and_is_controlled(mujoco):
    scene = adaptsim.mjcf(SCENE, {})
    times, states = adaptsim.run_mujoco(
        scene(p()),
        0.4,
        see=lambda d: [d.time, *d.body("puck").xpos[:1]],
        control=lambda d: d.ctrl.__setitem__(0, 1.0),
    )
    assert times[-1] == pytest.approx(0.4)
    assert states[:, 0] == pytest.approx(times)
    assert states[0, 1] == pytest.approx(0.04)
    assert states[-1, 1] > 0.1


def test_an_environment_has_its_parameters_by_path():
    pytest.importorskip("gymnasium")
    paths = {"m": "m", "top": "max_torque"}
    times, states = adaptsim.run_gym(
        "Pendulum-v1", p(m=2.0, top=1.0), paths, lambda obs: [0.0], lambda env: [env.m, env.max_torque], 4, 0.05, seed=0
    )
    assert times == pytest.approx([0.0, 0.05, 0.10, 0.15, 0.20])
    assert states == pytest.approx(np.tile([2.0, 1.0], (5, 1)))


@pytest.mark.parametrize(
    ("env_id", "paths", "start", "words"),
    [
        ("Pendulum-v1", {"m": "mas"}, lambda obs: [0.0], r"Pendulum-v1: m = 'mas': there is no attribute 'mas'; there"),
        ("Pendulum-v1", {"m": "state.m"}, lambda obs: [0.0], "m = 'state.m'"),
        ("NoSuch-v0", {}, lambda obs: [0.0], "'NoSuch-v0' is not an environment that can be made"),
        ("Pendulum-v1", {}, lambda obs: [0.0, 0.0], r"an action of shape \(2,\); Pendulum-v1 takes \(1,\)"),
        ("Pendulum-v1", {"k": "m"}, lambda obs: [0.0], "p has no 'k': there is m"),
    ],
)
def test_a_wrong_environment_says_what_is_right(env_id, paths, start, words):
    pytest.importorskip("gymnasium")
    with pytest.raises(adaptsim.TaskError, match=words):
        adaptsim.run_gym(env_id, p(m=1.0), paths, start, lambda env: env.state, 2, 0.05)


SDF = """<sdf version="1.7"><model name="slider"><link name="box"><inertial><mass>1.0</mass></inertial></link>
<joint name="slide" type="prismatic"><parent>world</parent><child>box</child><axis><xyz>1 0 0</xyz>
<dynamics><damping>1.0</damping></dynamics><limit><effort>100</effort></limit></axis></joint></model></sdf>
"""


def test_a_scene_of_drake_has_its_parameters_by_the_names_of_its_file(tmp_path):
    (tmp_path / "slider.sdf").write_text(SDF)
    scene = adaptsim.drake(
        str(tmp_path / "slider.sdf"),
        {"mass": "link/box/inertial/mass", "damping": "joint/slide/axis/dynamics/damping"},
        time_step=0.01,
    )

    def end(**values):
        model = scene(p(**values))
        times, states = adaptsim.run_drake(
            model, 0.5, see=lambda plant, c: plant.GetPositions(c), control=lambda plant, c: [2.0], every=0.1
        )
        assert times[-1] == pytest.approx(0.5)
        return states[-1, 0]

    assert end(mass=1.0, damping=0.0) == pytest.approx(0.5 * 2.0 * 0.5**2, rel=0.05)
    assert end(mass=2.0, damping=0.0) == pytest.approx(0.25 * 2.0 * 0.5**2, rel=0.05)
    assert end(mass=1.0, damping=5.0) < 0.5 * end(mass=1.0, damping=0.0)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("link/bax/inertial/mass", r"there is no link 'bax'; there is box; did you mean box\?"),
        ("link/box/inertia/mass", r"there is no element 'inertia'; there is inertial"),
        ("joint/slide/axis/xyz", r"xyz has 3 numbers; choose one of them, as xyz\[0\]"),
        ("mass", "a path is kind/name/element"),
    ],
)
def test_a_wrong_path_of_drake_names_what_there_is(tmp_path, path, words):
    (tmp_path / "slider.sdf").write_text(SDF)
    with pytest.raises(adaptsim.TaskError, match=words):
        adaptsim.drake(str(tmp_path / "slider.sdf"), {"mass": path})


ROLL = "t = [0.0, 1.0]; a = json.loads(line); x = a['action']['push'] / a['parameters']['mu']"
STAYS = f"""import json, os, sys
for line in sys.stdin:
    {ROLL}
    print(json.dumps({{"t_s": t, "state": [[0.0, os.getpid()], [x, os.getpid()]]}}), flush=True)
"""
ONCE = f"""import json, os, sys
line = sys.stdin.read()
{ROLL}
print("a line of a log")
print(json.dumps({{"t_s": t, "state": [[0.0, os.getpid()], [x, os.getpid()]]}}))
"""
LINGERS = f"""import json, os, sys, time
line = sys.stdin.readline()
{ROLL}
print(json.dumps({{"t_s": t, "state": [[0.0, os.getpid()], [x, os.getpid()]]}}), flush=True)
os.close(1)
time.sleep(0.05)
"""


@pytest.fixture
def simulator(tmp_path):
    def write(text: str, **options):
        path = tmp_path / "sim.py"
        path.write_text(text)
        return adaptsim.program(f"{sys.executable} {path}", **options)

    return write


@pytest.mark.parametrize(
    ("text", "stays", "keep"),
    [(STAYS, True, None), (ONCE, False, False), (STAYS, False, False), (LINGERS, False, None)],
)
def test_a_program_answers_and_is_kept_if_it_stays(simulator, text, stays, keep):
    ask = simulator(text, keep=keep)
    answers = [ask(p(mu=0.5), action=Values("action", {"push": push})) for push in (1.0, 2.0)]
    assert [states[-1, 0] for _, states in answers] == [2.0, 4.0]
    assert (answers[0][1][0, 1] == answers[1][1][0, 1]) == stays
    if ask.mode.running is not None:
        ask.mode.running.end()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("import sys; sys.exit('no licence')", "ended with exit code 1 and gave no JSON object: no licence"),
        ("print('hello')", "exit code 0 and gave no JSON object: hello"),
        ('print(\'{"error": "did not converge"}\')', "reports an error: did not converge"),
        ("print('{\"t_s\": [0]}')", "answers t_s: it must answer t_s and state"),
        ("import time; time.sleep(60)", "has not answered within 1 s"),
    ],
)
def test_a_program_that_fails_says_so(simulator, text, words):
    with pytest.raises(adaptsim.TaskError, match=words):
        simulator(text, keep=False, limit_s=1.0)(p(mu=0.5))


def test_a_program_may_name_its_columns_in_any_order(simulator):
    ask = simulator('print(\'{"t_s": [0, 1], "state": {"v": [2, 3], "x": [0, 1]}}\')', keep=False)
    _, states = ask(p(mu=0.5))
    assert states["x"].tolist() == [0.0, 1.0], "the task takes them by name"
    with pytest.raises(adaptsim.TaskError, match=r"answers state that are not numbers of one shape"):
        simulator('print(\'{"t_s": [0, 1], "state": [[0], [1, 2]]}\')', keep=False)(p(mu=0.5))


def test_a_program_that_is_missing_is_said():
    with pytest.raises(adaptsim.TaskError, match=r"the program `./no_such_sim` cannot be started in"):
        adaptsim.program("./no_such_sim")(p(mu=0.5))


def test_a_program_gets_plain_numbers(simulator):
    ask = simulator("import sys; print(sys.stdin.readline().replace('parameters', 'error'))", keep=False)
    with pytest.raises(adaptsim.TaskError, match=r"reports an error: \{'mu': 0.5, 'ground': 'ice'\}"):
        ask(p(mu=np.float64(0.5), ground="ice"))


def test_a_sensor_is_late_scaled_and_off():
    times, states = adaptsim.sensor([0.0, 1.0, 2.0], [[0.0], [1.0], [4.0]], delay=0.5, gain=2.0, bias=0.1)
    assert times.tolist() == [0.0, 1.0, 2.0]
    assert states[:, 0] == pytest.approx([0.1, 1.1, 5.1])
