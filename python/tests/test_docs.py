"""Docstrings: their examples work, and every public item has one and a stub."""

from __future__ import annotations

import ast
import doctest
from pathlib import Path

import docstrings
import pytest

import stillpoint_slam as sp
from stillpoint_slam import _native


def test_examples_in_docstrings() -> None:
    result = doctest.testmod(docstrings, optionflags=doctest.ELLIPSIS)
    assert result.failed == 0 and result.attempted > 20


def test_everything_public_has_a_docstring_and_a_stub() -> None:
    stub = ast.parse((Path(sp.__file__).parent / "_native.pyi").read_text())
    stubs: dict[str, set[str]] = {}
    for node in stub.body:
        if isinstance(node, ast.ClassDef):
            stubs[node.name] = {m.name for m in node.body if isinstance(m, ast.FunctionDef)}
        elif isinstance(node, ast.FunctionDef):
            stubs[node.name] = set()
    for name in sp.__all__:
        value = getattr(sp, name)
        if name == "__version__":
            continue
        assert value.__doc__, name
        if not hasattr(_native, name):
            continue
        assert name in stubs, f"{name} is not in the stubs"
        if not isinstance(value, type):
            continue
        public = {m for m in vars(value) if not m.startswith("_")}
        assert all(getattr(value, m).__doc__ for m in public), [m for m in public if not getattr(value, m).__doc__]
        told = {m for m in stubs[name] if not m.startswith("_")}
        assert public == told, f"{name}: {public ^ told}"


@pytest.mark.parametrize("path", sorted((Path(__file__).parents[1] / "examples").glob("*.py")), ids=lambda p: p.name)
def test_examples_are_short(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= 20
