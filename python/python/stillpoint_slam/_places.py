"""Locations of recordings and results: local paths, and URLs that ``fsspec`` supports (``s3://``, ``gs://``, ``file://``)."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from . import _native

_FETCHED = Path(tempfile.gettempdir()) / "stillpoint-fetched"


def is_url(path: str) -> bool:
    """Whether a path is a URL for ``fsspec``, instead of a local path."""
    return "://" in path


def _open(url: str, options: Mapping[str, Any]) -> tuple[Any, str]:
    try:
        from fsspec.core import url_to_fs
    except ImportError as e:
        raise ImportError("URLs need fsspec: pip install stillpoint-slam[ray], and s3fs or gcsfs for s3:// or gs://") from e
    fs, path = url_to_fs(url, **options)
    # Makes files of other writers visible.
    fs.invalidate_cache()
    return fs, path


def name_of(path: str) -> str:
    """The name of a result folder: the last part of a path, without the extension of recording files."""
    last = path.rstrip("/").rsplit("/", 1)[-1]
    stem, dot, ending = last.rpartition(".")
    is_file = ending.lower() in ("mcap", "bag", "db3") and (is_url(path) or not os.path.isdir(path))
    return stem if dot and stem and is_file else last


class Source:
    """A recording, with its digest and a local copy."""

    def __init__(self, path: str, options: Mapping[str, Any]) -> None:
        self.path = path
        self.sha256, self.bytes = _native.input_digest(path) if not is_url(path) else self._remote(options)
        self._options = options

    def _remote(self, options: Mapping[str, Any]) -> tuple[str, int]:
        """Digest of the URL and, of every file, name, size and version (an ETag or a time); and the total size."""
        fs, root = _open(self.path, options)
        files = fs.find(root, detail=True) if fs.isdir(root) else {root: fs.info(root)}
        if not files:
            raise FileNotFoundError(f"{self.path}: expected a recording, found nothing")
        digest = hashlib.sha256(self.path.encode())
        for name in sorted(files):
            digest.update(f"{name}\0{files[name]['size']}\0{fs.ukey(name)}\0".encode())
        return digest.hexdigest(), sum(f["size"] or 0 for f in files.values())

    @contextlib.contextmanager
    def local(self, most: float) -> Iterator[str]:
        """A local path to the recording, valid in the context; recordings at URLs of at most ``most`` bytes are downloaded.

        Raises:
            ValueError: the recording is larger, or exceeds the free disk space.
        """
        if not is_url(self.path):
            yield self.path
            return
        _FETCHED.mkdir(exist_ok=True)
        free = shutil.disk_usage(_FETCHED).free
        if self.bytes > min(most, free):
            what = f"disk={most:.3g}" if most < free else f"{free / 1e9:.1f} GB free in {_FETCHED}"
            raise ValueError(f"{self.path}: expected a recording that fits into {what}, found one of {self.bytes / 1e9:.2f} GB")
        with _folder() as folder:
            fs, root = _open(self.path, self._options)
            target = folder / root.rstrip("/").rsplit("/", 1)[-1]
            fs.get(root, str(target), recursive=fs.isdir(root))
            yield str(target)


@contextlib.contextmanager
def _folder() -> Iterator[Path]:
    """A temporary folder; first removes those of killed workers."""
    import fcntl

    for old in _FETCHED.iterdir():
        with contextlib.suppress(OSError), (old / "lock").open("a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(old, ignore_errors=True)
    folder = Path(tempfile.mkdtemp(dir=_FETCHED))
    try:
        # The system unlocks it when the process ends, even if killed.
        with (folder / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class Results:
    """The result folder of a recording, at a path or a URL."""

    def __init__(self, out: str, name: str, options: Mapping[str, Any]) -> None:
        self.folder = f"{out.rstrip('/')}/{name}"
        self._fs: Any = None
        self._root = self.folder
        if is_url(out):
            self._fs, self._root = _open(self.folder, options)

    def read(self, name: str) -> str | None:
        """The text of a file; None if it does not exist."""
        try:
            if self._fs is None:
                return Path(self._root, name).read_text(encoding="utf-8")
            return str(self._fs.cat_file(f"{self._root}/{name}").decode())
        except FileNotFoundError:
            return None

    def write(self, name: str, text: str) -> None:
        """Writes a file atomically."""
        if self._fs is not None:
            self._fs.pipe_file(f"{self._root}/{name}", text.encode())
            return
        path = Path(self._root, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        aside = path.with_name(f".{path.name}.{os.getpid()}")
        aside.write_text(text, encoding="utf-8")
        aside.replace(path)

    def remove(self, name: str) -> None:
        with contextlib.suppress(FileNotFoundError):
            if self._fs is None:
                Path(self._root, name).unlink()
            else:
                self._fs.rm_file(f"{self._root}/{name}")

    @contextlib.contextmanager
    def filling(self) -> Iterator[Path]:
        """A local folder for writing the result; uploaded at the end if the result is at a URL."""
        if self._fs is None:
            yield Path(self._root)
            return
        with tempfile.TemporaryDirectory(prefix="stillpoint-result-") as folder:
            yield Path(folder)
            for file in sorted(p for p in Path(folder).rglob("*") if p.is_file()):
                self._fs.put_file(str(file), f"{self._root}/{file.relative_to(folder).as_posix()}")
