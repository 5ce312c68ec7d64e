"""Parallel runs over many recordings: the command line's ``batch`` in a separate process, and its results."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, overload

from ._native import Config

_Path = str | os.PathLike[str]


class Batch(Sequence[Mapping[str, Any]]):
    """Results of a batch: a sequence of its rows, sorted by name, as dicts with the columns of ``batch.parquet``.

    Attributes:
        folder: folder of the table and results.
        is_complete: whether every recording has a row; False if the batch was interrupted.
        skipped: number of recordings with existing results.
        seconds: duration from the start of the first run to the end of the last.
    """

    def __init__(self, folder: _Path) -> None:
        self.folder = Path(folder)
        table = json.loads((self.folder / "batch.json").read_text(encoding="utf-8"))
        self.is_complete: bool = table["is_complete"]
        self.skipped: int = table["skipped"]
        self.seconds: float = table["seconds"]
        self._rows: list[dict[str, Any]] = table["recordings"]

    @property
    def failed(self) -> list[Mapping[str, Any]]:
        """The rows of recordings without a result, with the reason in ``error``."""
        return [row for row in self._rows if row["outcome"] == "failed"]

    def __len__(self) -> int:
        return len(self._rows)

    @overload
    def __getitem__(self, index: int) -> Mapping[str, Any]: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Mapping[str, Any]]: ...
    def __getitem__(self, index: int | slice) -> Mapping[str, Any] | Sequence[Mapping[str, Any]]:
        return self._rows[index]

    def __iter__(self) -> Iterator[Mapping[str, Any]]:
        return iter(self._rows)

    def __repr__(self) -> str:
        failed = f", {len(self.failed)} without a result" if self.failed else ""
        early = "" if self.is_complete else ", ended early"
        return f"<Batch: {len(self)} recordings{failed}{early}>"


def batch(
    inputs: _Path | Iterable[_Path],
    out: _Path,
    *,
    workers: int | None = None,
    shard: tuple[int, int] | None = None,
    time_limit: float | None = None,
    replace: bool = False,
    name_parts: int = 1,
    camera: str | None = None,
    config: Config | _Path | Mapping[str, Any] | None = None,
    detector: _Path | None = None,
    dense: bool | float = False,
    save_map: str | None = None,
    report: bool = True,
    start: int = 0,
    max_frames: int | None = None,
    progress: bool = True,
) -> Batch:
    """Runs many recordings, as ``stillpoint batch`` does: each in a separate process, in parallel, skipping existing results.

    Args:
        inputs: recordings, data set folders, and patterns (``data/*.mcap``); one or many.
        out: folder of the results.
        workers: parallel runs; None for as many as cores and free memory allow.
        shard: (I, N) for the I-th of N shards, from 1 on; each needs its own ``out``, and :func:`batch_merge` joins them.
        time_limit: maximum duration of a run, s.
        replace: whether to replace results of another program or configuration.
        name_parts: number of last parts of a path that form the name of its result folder.
        camera, config, dense, start, max_frames: as for :func:`run`.
        detector: as for ``--detector``; ``{}`` in it stands for the recording.
        save_map: name of a map file in each result folder; None for no map.
        report: whether to write a ``report.html`` into each.
        progress: whether to show the command line's progress.

    Returns:
        The rows, including recordings without a result: see :attr:`Batch.failed`.

    Raises:
        ValueError: invalid inputs or options, or a folder that cannot be written; the message names it.
        KeyboardInterrupt: Ctrl-C; finished results are kept, and repeating the call continues.
    """
    all_inputs = [inputs] if isinstance(inputs, (str, os.PathLike)) else list(inputs)
    if not all_inputs:
        raise ValueError("inputs: expected recordings, found none")
    options: dict[str, Any] = {
        "--workers": workers,
        "--shard": None if shard is None else f"{shard[0]}/{shard[1]}",
        "--time-limit": time_limit,
        "--name-parts": name_parts,
        "--camera": camera,
        "--detector": None if detector is None else os.fspath(detector),
        "--voxel": None if isinstance(dense, bool) else dense,
        "--save-map": save_map,
        "--start": start,
        "--max-frames": max_frames,
    }
    flags = {"--replace": replace, "--dense": dense is not False, "--no-report": not report}
    words = [f"{option}={value}" for option, value in options.items() if value is not None]
    words += [flag for flag, is_set in flags.items() if is_set]
    with tempfile.TemporaryDirectory(prefix="stillpoint-batch-") as folder:
        listed = Path(folder) / "inputs.txt"
        listed.write_text("".join(f"{_line(i)}\n" for i in all_inputs), encoding="utf-8")
        if config is not None:
            file = Path(folder) / "config.toml"
            file.write_text(_config(config).to_toml(), encoding="utf-8")
            words.append(f"--config={file}")
        return _command(["batch", f"--list={listed}", f"--out={os.fspath(out)}", *words], out, progress)


def batch_merge(folders: Iterable[_Path], out: _Path, *, progress: bool = True) -> Batch:
    """Joins the tables of several batches, such as the shards of one, without moving the results.

    Args:
        folders: folders of batches of one program and configuration.
        out: folder of the joined table.
        progress: whether to show the command line's progress.

    Raises:
        ValueError: folders of different programs or configurations.
    """
    return _command(["batch", "merge", *(os.path.abspath(f) for f in folders), f"--out={os.fspath(out)}"], out, progress)


def _line(path: _Path) -> str:
    line = os.fspath(path)
    if "\n" in line or line != line.strip() or line.startswith("#"):
        raise ValueError(f"inputs: expected paths without line breaks, blanks at their ends, and # at the beginning, found {line!r}")
    return line


def _config(config: Config | _Path | Mapping[str, Any]) -> Config:
    if isinstance(config, Config):
        return config
    if isinstance(config, (str, os.PathLike)):
        return Config(file=config)
    return Config(config)


def _command(arguments: Sequence[str], out: _Path, progress: bool) -> Batch:
    """Runs a command line in a separate process, and reads the resulting table."""
    command = [sys.executable, "-m", "stillpoint_slam", *arguments]
    said: list[str] = []
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, encoding="utf-8", errors="replace") as child:
        assert child.stderr is not None
        try:
            for line in child.stderr:
                said.append(line)
                if progress:
                    sys.stderr.write(line)
        except BaseException:
            # In a terminal the child has received Ctrl-C too; a second signal would kill it.
            if not sys.stdin or not sys.stdin.isatty():
                child.send_signal(signal.SIGINT)
            child.wait()
            raise
    if child.returncode not in (0, 1):
        errors = [line.removeprefix("error: ").strip() for line in said if line.startswith("error: ")]
        raise ValueError(errors[-1] if errors else f"the batch ended with {child.returncode}: {''.join(said[-5:])}")
    return Batch(out)
