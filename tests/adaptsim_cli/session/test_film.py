"""The film of a trial: one sheet of small pictures, small enough for a page, and a camera to draw over it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from adaptsim_cli.session import recording
from adaptsim_cli.session.film import COLUMNS, FILM, MOST_BYTES, ROWS, Filmed
from adaptsim_cli.session.store import SessionStore
from hw.bounded import decode_image
from hw.poses import inverse
from perception.geometry import project


@pytest.fixture
def filmed(undisturbed: SessionStore) -> Filmed:
    store = undisturbed
    record = store.trials(0)[0]
    stored = recording.read(store.trial_folder(*record.place) / recording.FILE)
    track, start_s = record.track.track(), stored.execution.t_start_s
    return Filmed(stored.frames, stored.model, stored.X_BC, start_s, track, track.state[0, :2], None)


def test_every_trial_has_its_film(undisturbed):
    for record in undisturbed.trials(0):
        sheet = decode_image((undisturbed.trial_folder(*record.place) / FILM).read_bytes(), cv2.IMREAD_COLOR)
        assert sheet.shape == (ROWS * 240, COLUMNS * 240, 3)
        assert record.film is not None and record.film.end_s == record.track.t_s[-1]
        assert FILM in record.checksums


def test_what_is_drawn_over_the_film_lies_where_the_camera_sees_it(filmed):
    film, _ = filmed.sheet()
    left, top, right, bottom = filmed._window(with_goal=True)
    p_m = filmed.track.state[:, :3]
    u, v, w = np.array(film.camera).reshape(3, 4) @ np.column_stack([p_m, np.ones(len(p_m))]).T
    seen = project(filmed.model.colour, inverse(filmed.X_BC), p_m)
    wanted = (seen - [left, top]) / [right - left, bottom - top]
    assert np.abs(np.column_stack([u / w, v / w]) - wanted).max() < 1 / 240


def test_a_goal_beside_the_path_is_in_the_picture(filmed):
    goal_m = filmed.track.state[-1, :2] + [0.0, 0.01]
    film, _ = replace(filmed, goal_m=goal_m).sheet()
    u, v, w = np.array(film.camera).reshape(3, 4) @ [*goal_m, 0.0, 1.0]
    assert 0 < u / w < 1 and 0 < v / w < 1


def test_even_noise_fits_a_page(filmed):
    rng = np.random.default_rng(0)
    frames = [replace(f, colour=rng.integers(0, 256, f.colour.shape, np.uint8)) for f in filmed.frames]
    _, files = replace(filmed, frames=frames).sheet()
    assert len(files[FILM]) <= MOST_BYTES
