import dataclasses
import os
import select
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from toy_task import TOY, equal_rollouts, simulate

from perception.types import Outcome
from sim.errors import RolloutError
from sim.rollouts.dataset import dataset_requests
from sim.rollouts.executors import process_pool, serial_executor
from sim.rollouts.run import OUTCOMES, Requests, run_many, run_parts
from sim.tasks import get_task
from sim.tasks.fingerprint import scene_key
from sim.tasks.scooping import rollout as scooping_rollout
from sim.tasks.scooping import scene as scooping_scene


def raising(parameters, context, action, nuisance, unmodelled=None):
    if parameters[0] > 0.44:
        raise ZeroDivisionError("the scene fell apart")
    return simulate(parameters, context, action, nuisance, unmodelled)


def dying(parameters, context, action, nuisance, unmodelled=None):
    os._exit(3)


def test_each_row_is_the_rollout_of_its_request():
    requests = dataset_requests(TOY, 0, 21)
    with serial_executor() as executor:
        rollouts = run_many(TOY, requests, executor)
    for i in (0, 7, 8, 20):
        track = simulate(requests.parameters[i], requests.context[i], requests.action[i], requests.nuisance[i])
        assert np.array_equal(rollouts.observation[i], TOY.observation(track))
        assert rollouts.succeeded[i] == (track.outcome is Outcome.ON_BLADE)
        assert OUTCOMES[rollouts.outcome[i]] is track.outcome
        assert rollouts.rewards(TOY, requests.context)[i] == pytest.approx(TOY.score(track, requests.context[i]))


def test_same_numbers_for_threads_processes_and_one_after_the_other():
    requests = dataset_requests(TOY, 1, 50)
    with serial_executor() as one, ThreadPoolExecutor(3) as threads, process_pool(2) as processes:
        first = run_many(TOY, requests, one)
        assert equal_rollouts(first, run_many(TOY, requests, threads))
        assert equal_rollouts(first, run_many(TOY, requests, processes))


class Counting(ThreadPoolExecutor):
    calls = 0

    def submit(self, *args, **kwargs):
        self.calls += 1
        return super().submit(*args, **kwargs)


@pytest.mark.parametrize(("rollouts", "calls"), [(2, 2), (40, 20), (128, 16), (400, 50)])
def test_few_rollouts_keep_several_workers_busy_and_many_go_in_chunks(rollouts, calls):
    with Counting(2) as executor:
        run_many(TOY, dataset_requests(TOY, 0, rollouts), executor)
    assert executor.calls == calls


def test_parts_come_in_order_and_later_ones_are_simulated_meanwhile():
    parts = [dataset_requests(TOY, seed, size) for seed, size in ((0, 40), (1, 128), (2, 3))]
    seen = []
    with Counting(2) as executor:
        found = run_parts(TOY, parts, executor, lambda done, total: seen.append((done, total)))
        first = next(found)
        assert executor.calls == 20 + 16 + 3  # of all parts
        rest = list(found)
        expected = [run_many(TOY, part, executor) for part in parts]
    assert all(equal_rollouts(one, other) for one, other in zip([first, *rest], expected, strict=True))
    assert seen == sorted(seen) and seen[-1] == (171, 171)


def test_whoever_leaves_the_parts_early_leaves_no_work_behind():
    began = []

    def counting(*request):
        began.append(request)
        return simulate(*request)

    parts = [dataset_requests(TOY, seed, 128) for seed in range(50)]
    with Counting(1) as executor:
        found = iter(run_parts(dataclasses.replace(TOY, simulate=counting), parts, executor))
        next(found)
        del found
    assert executor.calls == 50 * 16
    assert 128 <= len(began) < 50 * 128


def test_a_raising_rollout_is_named():
    task = dataclasses.replace(TOY, simulate=raising)
    requests = dataset_requests(TOY, 0, 64)
    with serial_executor() as executor, pytest.raises(RolloutError, match="scene fell apart") as caught:
        run_many(task, requests, executor)
    first_bad = int(np.flatnonzero(requests.parameters[:, 0] > 0.44)[0])
    start = first_bad // 4 * 4
    assert f"rollouts {start}-{start + 3} of 64" in str(caught.value)


def test_a_dead_worker_is_an_error_that_names_the_requests_and_so_is_the_broken_pool():
    task = dataclasses.replace(TOY, simulate=dying)
    with process_pool(1) as executor:
        for _ in range(2):
            with pytest.raises(RolloutError, match=r"rollouts 0-7.*a worker died"):
                run_many(task, dataset_requests(TOY, 0, 128), executor)


def test_nothing_to_run_and_wrong_shapes_are_refused():
    with serial_executor() as executor, pytest.raises(ValueError, match="no requests"):
        run_many(TOY, dataset_requests(TOY, 0, 8)[:0], executor)
    with pytest.raises(ValueError, match="action has shape"):
        Requests(np.zeros((3, 4)), np.zeros((3, 2)), np.zeros((2, 2)), np.zeros((3, 1)))


@pytest.mark.long
def test_kept_rollouts_are_of_another_scene_when_the_tool_or_the_end_of_a_trial_changes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    task = get_task("scooping")
    before = scene_key(task)
    assert scene_key(task) == before
    with monkeypatch.context() as patch:
        patch.setattr(scooping_scene, "NECK_SIZE_M", (1e-3, 1e-3, 1e-3))
        assert scene_key(task) != before
    with monkeypatch.context() as patch:
        patch.setattr(scooping_rollout, "LATEST_S", 1.0)
        assert scene_key(task) != before


_OPENS_A_POOL = """
import os
from sim.rollouts.executors import process_pool

if __name__ == "__main__":
    with process_pool(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        input()
"""


def _ignores_interrupts() -> bool:
    return signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_workers_leave_interrupts_to_their_parent() -> None:
    with process_pool(1) as pool:
        assert pool.submit(_ignores_interrupts).result()


def test_workers_do_not_outlive_a_killed_parent(tmp_path) -> None:
    script = tmp_path / "opens_a_pool.py"
    script.write_text(_OPENS_A_POOL)
    parent = subprocess.Popen(
        [sys.executable, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    assert parent.stdin is not None and parent.stdout is not None
    int(parent.stdout.readline())  # the worker is up
    parent.kill()
    # The worker, and the tracker beside it, hold the same pipe: its end is reached only once all of them are gone.
    ended, _, _ = select.select([parent.stdout], [], [], 60)
    assert ended and parent.stdout.read() == ""
    parent.wait()
    parent.stdin.close()
    parent.stdout.close()
