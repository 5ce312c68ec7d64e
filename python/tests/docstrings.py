"""Examples in docstrings: ``python -m doctest -o ELLIPSIS docstrings.py``."""

from __future__ import annotations

import stillpoint_slam
from stillpoint_slam import *  # noqa: F403


def _texts() -> dict[str, str]:
    texts = {"package": stillpoint_slam.__doc__ or ""}
    for name in stillpoint_slam.__all__:
        value = getattr(stillpoint_slam, name)
        texts[name] = getattr(value, "__doc__", None) or ""
        for member, inner in vars(value).items() if isinstance(value, type) else ():
            if not member.startswith("_"):
                texts[f"{name}.{member}"] = getattr(inner, "__doc__", None) or ""
    return texts


__test__ = {name: text for name, text in _texts().items() if ">>>" in text}
