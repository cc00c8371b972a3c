"""Plain chessboards in photographs of a room: a board is found where it is, and nothing else is taken for one."""

from __future__ import annotations

import pytest
from boards_in_rooms import board_in_room, distance_px, photograph
from real_views import camera

from perception.board import find
from perception.board.targets import Chessboard
from perception.errors import BoardNotFound

SMALL = Chessboard(4, 5, 0.03)


@pytest.mark.parametrize("number", [0, 8])
@pytest.mark.parametrize("is_inverted", [False, True], ids=["white rim", "dark rim"])
def test_a_small_board_is_found_where_it_is_or_not_at_all(number: int, is_inverted: bool) -> None:
    shown = board_in_room(SMALL, number, is_inverted=is_inverted)
    assert distance_px(find(shown.picture, SMALL, shown.camera).px, shown) < 0.5


def test_nothing_else_of_the_room_is_a_board() -> None:
    with pytest.raises(BoardNotFound, match="no chessboard"):
        find(photograph(4), SMALL, camera(2))
