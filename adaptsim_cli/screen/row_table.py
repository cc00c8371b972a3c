"""A table for a terminal of any width: nothing is cut, and no number is broken."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

LONGEST_WORD = 24
"""A longer word, such as a path, may be broken to fit a table."""
_GAP = 3  # columns between two columns of a table


@dataclass(frozen=True)
class RowTable:
    """Rows under their heads; where the words do not fit side by side, a block per row with a line for each column."""

    head: Sequence[str]
    body: Sequence[Sequence[str]]
    right: Sequence[int] = ()  # the columns of numbers, which are aligned at the right
    whole: Sequence[int] = ()  # the columns that are never broken within a line, such as drawings

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield self._table() if self._least_width() <= options.max_width else self._blocks()

    def _least_width(self) -> int:
        """The width at which every word of up to `LONGEST_WORD` columns fits."""
        columns = range(len(self.head))
        return sum(max(self._lengths(index), default=0) for index in columns) + _GAP * (len(columns) - 1)

    def _lengths(self, index: int) -> Iterator[int]:
        """The lengths of the parts of a column that stay whole."""
        for text in chain([self.head[index]], (cells[index] for cells in self.body)):
            if index in self.whole:
                yield from map(cell_len, text.splitlines())
            else:
                yield from (min(cell_len(word), LONGEST_WORD) for word in text.split())

    def _table(self) -> Table:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
        for index, name in enumerate(self.head):
            table.add_column(name, overflow="fold", no_wrap=index in self.whole)
            if index in self.right:
                table.columns[index].justify = "right"
        for cells in self.body:
            table.add_row(*map(Text, cells))
        return table

    def _blocks(self) -> Table:
        table = Table(box=None, show_header=False, pad_edge=False)
        table.add_column(style="dim", overflow="fold")
        table.add_column(overflow="fold")
        for number, cells in enumerate(self.body):
            if number:
                table.add_row("", "")
            for name, cell in zip(self.head, cells, strict=True):
                if cell:
                    table.add_row(name, Text(cell))
        return table
