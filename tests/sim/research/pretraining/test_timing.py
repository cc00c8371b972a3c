import pytest

from sim.errors import DatasetError
from sim.research.pretraining.logs import TIMINGS, Stopwatch, wall_times_s


def test_time_counts_for_the_stage_that_is_reported_and_goes_on_after_a_kill(tmp_path):
    now, seen = [100.0], []

    def report(watch, stage, after_s, done):
        now[0] += after_s
        watch(stage, done, 4)

    first = Stopwatch(tmp_path, lambda *call: seen.append(call), lambda: now[0])
    report(first, "dataset", 3.0, 1)
    assert wall_times_s(tmp_path) == {}  # not written yet
    report(first, "dataset", 4.0, 2)  # 7 s since the start: written; then it is killed
    now[0] += 1000.0
    second = Stopwatch(tmp_path, lambda *call: seen.append(call), lambda: now[0])
    report(second, "dataset", 2.0, 4)
    report(second, "emulator", 1.5, 4)
    assert wall_times_s(tmp_path) == {"dataset": 9.0, "emulator": 1.5}
    assert seen == [("dataset", 1, 4), ("dataset", 2, 4), ("dataset", 4, 4), ("emulator", 4, 4)]


def test_a_damaged_file_of_times_is_named(tmp_path):
    (tmp_path / TIMINGS).write_text("seconds = 3")
    with pytest.raises(DatasetError, match=TIMINGS):
        wall_times_s(tmp_path)
