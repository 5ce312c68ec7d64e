"""Fixtures: recordings, cameras and images."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import stillpoint_slam as sp

ROOT = Path(__file__).resolve().parents[2]


def data(name: str) -> Path:
    """A recording in STILLPOINT_DATA, else in ../shared/data beside the repository. Skips the test if it is missing."""
    folder = Path(os.environ.get("STILLPOINT_DATA", ROOT.parent / "shared" / "data"))
    path = folder / name
    if not path.exists():
        pytest.skip(f"no recording {name} in {folder}")
    return path


@pytest.fixture
def camera() -> sp.Camera:
    """A small camera: images of 64x48 px."""
    return sp.Camera(64, 48, 55.0, 55.0, 31.5, 23.5)


@pytest.fixture
def color() -> np.ndarray:
    """Noise with corners, as a colour image for the small camera."""
    return np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)


@pytest.fixture
def depth() -> np.ndarray:
    """A wall at 2 m, as a depth image in millimetres for the small camera."""
    return np.full((48, 64), 2000, dtype=np.uint16)


@pytest.fixture(scope="session")
def room() -> sp.Simulation:
    """A room without people."""
    return sp.simulate("xyz", frames=12)


@pytest.fixture(scope="session")
def images(room: sp.Simulation) -> list[sp.RgbdFrame]:
    """Its frames, rendered once."""
    return list(room)
