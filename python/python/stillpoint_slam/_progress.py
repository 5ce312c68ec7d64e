"""Progress display: one element in a notebook, one line in a terminal, nothing elsewhere."""

from __future__ import annotations

import sys
import time
from typing import Any


def _in_notebook() -> bool:
    shell = sys.modules.get("IPython")
    get = getattr(shell, "get_ipython", None)
    return get is not None and type(get()).__name__ == "ZMQInteractiveShell"


class Progress:
    """Progress of a loop, as a context manager. The display is removed at the end."""

    def __init__(self, total: int, wanted: bool = True) -> None:
        self._total = total
        self._done = 0
        self._shown = 0.0
        self._start = time.monotonic()
        self._cell: Any = None
        self._terminal = wanted and not _in_notebook() and sys.stderr is not None and sys.stderr.isatty()
        self._notebook = wanted and _in_notebook()

    def __enter__(self) -> Progress:
        return self

    def step(self, note: str = "") -> None:
        """Counts one more frame."""
        self._done += 1
        now = time.monotonic()
        if now - self._shown < 0.2 or not (self._terminal or self._notebook):
            return
        self._shown = now
        rate = self._done / max(now - self._start, 1e-9)
        text = f"{self._done}/{self._total} frames, {rate:.1f} per second{note}"
        if self._terminal:
            sys.stderr.write(f"\r\x1b[K{text}")
            sys.stderr.flush()
            return
        html = f"<progress max='{self._total}' value='{self._done}'></progress> {text}"
        self._display(html)

    def _display(self, html: str) -> None:
        from IPython.display import HTML, display

        if self._cell is None:
            self._cell = display(HTML(html), display_id=True)
        else:
            self._cell.update(HTML(html))

    def __exit__(self, *how: object) -> None:
        if self._terminal:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
        if self._cell is not None:
            self._display(f"{self._done}/{self._total} frames")
