#!/usr/bin/env python3
"""Builds the wheel and checks it with each Python in a fresh environment. Prints how many checks passed, failed and were skipped, and why.

    python3 python/check.py                 all checks; packages from PyPI
    python3 python/check.py --wheel FILE    checks an existing wheel
    python3 python/check.py --build FOLDER  only builds the wheel into a folder and inspects it
    python3 python/check.py --here          with this Python and its packages, installing nothing, as .ci/run does with its own --profiles
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
VERSIONS = ["3.10", "3.11", "3.12", "3.13", "3.14"]
LARGEST = 15e6
# All systems with these Pythons have this C library or a later one.
LINUX = "manylinux_2_17"
TESTS = ["pytest", "hypothesis", "pillow"]
CLUSTERS = ["ray[data]", "s3fs", "moto[s3,server]", "dask", "distributed", "submitit"]
MORE = ["mypy", "matplotlib", "nbclient", "ipykernel", "nbformat", "opencv-python-headless"]

passed: list[str] = []
failed: list[str] = []
skipped: list[str] = []


def check(name: str, command: Sequence[object], env: dict[str, str] | None = None, cwd: Path | None = None) -> bool:
    """Runs a command, and prints its output on failure."""
    start = time.monotonic()
    done = subprocess.run([str(c) for c in command], env=env, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    is_well = done.returncode == 0
    (passed if is_well else failed).append(name)
    print(f"{'ok    ' if is_well else 'FAILED'} {name} ({time.monotonic() - start:.0f} s)", flush=True)
    if not is_well:
        print(done.stdout)
    elif name.startswith("measure"):
        print(done.stdout, end="")
    return is_well


def holds(name: str, is_so: bool, found: str) -> None:
    (passed if is_so else failed).append(name)
    print(f"{'ok    ' if is_so else 'FAILED'} {name}: {found}", flush=True)


def skip(name: str, reason: str) -> None:
    skipped.append(f"{name}: {reason}")
    print(f"skipped {name}: {reason}", flush=True)


def pythons() -> dict[str, Path]:
    """Installed Pythons, on the path or of pyenv, by version."""
    found: dict[str, Path] = {}
    for version in VERSIONS:
        candidates = [shutil.which(f"python{version}")]
        root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
        candidates += [str(p) for p in sorted(root.glob(f"{version}.*/bin/python"), reverse=True)]
        for path in filter(None, candidates):
            said = subprocess.run([path, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"], capture_output=True, text=True)
            # pyenv's shims may not work.
            if said.returncode == 0 and said.stdout.strip() == version:
                found[version] = Path(path)
                break
    return found


def environment(python: Path, folder: Path) -> Path:
    """A fresh virtual environment; returns its Python."""
    subprocess.run([python, "-m", "venv", folder], check=True)
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


class Tools:
    """Tools to build wheels: maturin, and on Linux zig, which links for an old C library."""

    def __init__(self, work: Path, may_install: bool) -> None:
        self.env = dict(os.environ)
        if may_install and not shutil.which("maturin"):
            tools = environment(Path(sys.executable), work / "tools")
            needs = ["maturin>=1.9,<2", *(["ziglang"] if sys.platform == "linux" else [])]
            subprocess.run([tools, "-m", "pip", "install", "-q", *needs], check=True)
            self.env["PATH"] = f"{tools.parent}{os.pathsep}{self.env['PATH']}"
        # maturin looks for zig in the same two places.
        self.has_zig = sys.platform == "linux" and (
            shutil.which("zig", path=self.env["PATH"]) is not None
            or subprocess.run(["python3", "-m", "ziglang", "version"], env=self.env, capture_output=True).returncode == 0
        )


def build(folder: Path, tools: Tools, profiles: Path | None, target: str | None = None) -> Path | None:
    # The stable ABI, so any interpreter will do.
    command: list[object] = ["maturin", "build", "--locked", "--out", folder, "-i", sys.executable]
    if target:
        command += ["--target", target]
    if profiles:
        # As for the library's tests, to reuse their builds.
        command += ["--profile", "dev", "--config", profiles]
    else:
        command += ["--release"]
        if tools.has_zig:
            command += ["--zig", "--compatibility", LINUX]
        else:
            skip("a wheel for older C libraries", "zig is not there (PyPI's ziglang), or this is not Linux")
    if not check("the wheel is built", command, env=tools.env, cwd=HERE):
        return None
    return next(folder.glob("*.whl"))


def quick_profiles(arguments: argparse.Namespace, work: Path) -> Path | None:
    """Profiles for quick builds; None for releases."""
    if not arguments.here:
        return None
    if arguments.profiles:
        return arguments.profiles.resolve()
    profiles = work / "profiles.toml"
    profiles.write_bytes(subprocess.run([HERE.parent / ".ci" / "profiles"], check=True, stdout=subprocess.PIPE).stdout)
    return profiles


def look_at(wheel: Path, is_local: bool) -> None:
    size = wheel.stat().st_size
    holds("the wheel has at most 15 MB", size <= LARGEST, f"{size / 1e6:.1f} MB")
    holds("it is for every Python from 3.10 on", "-cp310-abi3-" in wheel.name, wheel.name)
    with zipfile.ZipFile(wheel) as file:
        metadata = next(file.read(n).decode() for n in file.namelist() if n.endswith("/METADATA"))
        names = {Path(n).name for n in file.namelist()}
    needs = re.findall(r"^Requires-Dist: (.*)$", metadata, re.M)
    if "linux" in wheel.name and not is_local:
        holds("it is for every Linux with a C library of 2014 or later", LINUX in wheel.name, wheel.name)
    holds("NumPy is all it needs", [re.split(r"\W", n)[0] for n in needs] == ["numpy"], str(needs))
    holds("stubs and licences are in it", {"py.typed", "_native.pyi", "LICENSE-MIT", "LICENSE-APACHE", "NOTICES.md"} <= names, f"{len(names)} files")


def in_environment(version: str, python: Path, wheel: Path, work: Path) -> Path:
    """Checks the wheel without a compiler on the path, then runs the tests."""
    fresh = environment(python, work / version)
    pip = [fresh, "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    bare = {"PATH": str(fresh.parent), "HOME": str(work), "TMPDIR": str(work)}
    # Keep the machine's package index settings.
    bare.update({k: v for k, v in os.environ.items() if k.startswith(("PIP_", "SSL_", "REQUESTS_")) or k.lower().endswith("_proxy")})
    config = Path.home() / ".config" / "pip" / "pip.conf"
    if config.exists():
        bare.setdefault("PIP_CONFIG_FILE", str(config))
    if check(f"{version}: installs without a compiler", [*pip, "--only-binary", ":all:", wheel], env=bare):
        code = "import stillpoint_slam as sp; print(sp.run(sp.simulate('xyz', frames=5), progress=False))"
        check(f"{version}: runs with NumPy alone", [fresh, "-c", code], env=bare, cwd=work)
        check(f"{version}: the command line is on the path", ["stillpoint", "--version"], env={**bare, "PATH": str(fresh.parent)}, cwd=work)
    subprocess.run([*map(str, pip), *TESTS], check=True)
    check(f"{version}: tests", [fresh, "-m", "pytest", "-q", "-p", "no:cacheprovider", HERE / "tests"], cwd=work)
    return fresh


def with_everything(fresh: Path, work: Path, minutes: float) -> None:
    pip = [str(fresh), "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    subprocess.run([*pip, *MORE], check=True)
    check("plots", [fresh, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", "plots", HERE / "tests"], cwd=work)
    types(fresh, work)
    check("docstrings", [fresh, "-m", "doctest", "-o", "ELLIPSIS", HERE / "tests" / "docstrings.py"], cwd=work)
    run = "import sys, nbformat, nbclient; nbclient.NotebookClient(nbformat.read(sys.argv[1], 4), timeout=600).execute()"
    check("the notebook executes", [fresh, "-c", run, HERE / "examples" / "notebook.ipynb"], cwd=work)
    check("measurements", [fresh, HERE / "tests" / "measure.py", "--minutes", minutes], cwd=work)
    examples(fresh, work)
    clusters(fresh, work)


def clusters(fresh: Path, work: Path) -> None:
    """Batches on local clusters of Ray and Dask and by submitit, with a local S3 server."""
    pip = [str(fresh), "-m", "pip", "install", "-q", "--disable-pip-version-check", "--only-binary", ":all:"]
    if subprocess.run([*pip, *CLUSTERS]).returncode:
        return skip("batches on clusters", "Ray, Dask, submitit or moto cannot be had for this Python")
    tests = [HERE / "tests" / name for name in ("test_batch.py", "test_ray.py")]
    check("batches on clusters", [fresh, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests], cwd=work)
    return None


def types(python: Path, work: Path) -> None:
    command = [python, "-m", "mypy", "--strict", "--config-file", HERE / "pyproject.toml", "--cache-dir", work / "mypy", HERE / "python" / "stillpoint_slam"]
    check("types", [*command, *sorted((HERE / "examples").glob("*.py")), HERE / "check.py"], cwd=HERE)


def examples(fresh: Path, work: Path) -> None:
    check("a folder for the examples", [fresh, "-m", "stillpoint_slam", "simulate", "--scene", "xyz", "--frames", "100", "--out", work / "room", "-q"])
    check("example: a folder", [fresh, HERE / "examples" / "folder.py", work / "room", work / "trajectory.txt"], cwd=work)
    own_detector(fresh, work)
    check("example: masks", [fresh, HERE / "examples" / "mask_for_another_slam.py", work / "room", work / "masks"], cwd=work)


def own_detector(fresh: Path, work: Path) -> None:
    """The example of a custom YOLO, with a fake ultralytics: the poses must equal those with the same boxes from a file."""
    people, boxes = work / "people", work / "boxes.csv"
    line = [fresh, "-m", "stillpoint_slam"]
    check("a folder with people", [*line, "simulate", "--scene", "walking_xyz", "--frames", "40", "--out", people, "-q"])
    # Rounded to eighths of pixels, so that shifts by half a pixel are exact.
    text = (people / "detections.csv").read_text()
    boxes.write_text(re.sub(r"-?\d+\.\d{3}(?=[,\n])", lambda m: f"{round(8 * float(m[0])) / 8:.3f}", text))
    env = {**os.environ, "PYTHONPATH": str(HERE / "tests" / "standin"), "STANDIN_ROOM": str(people), "STANDIN_BOXES": str(boxes)}
    folder = work / "yolo"
    folder.mkdir()
    check("example: a YOLO of one's own", [fresh, HERE / "examples" / "yolo.py", people], env=env, cwd=folder)
    for name, detector in (("scripted", f"scripted:{boxes}"), ("blind", "none")):
        check(f"the same frames, {name}", [*line, "run", people, "--detector", detector, "--out", work / name, "-q"])
    poses = {f: (f / "trajectory.txt").read_bytes() if (f / "trajectory.txt").exists() else b"" for f in (folder / "out", work / "scripted", work / "blind")}
    ours, scripted, blind = poses.values()
    holds("a YOLO of one's own is as good as a file of its boxes", bool(ours) and ours == scripted and ours != blind, f"{len(ours.splitlines())} lines of poses")


def realsense(python: Path, wheel: Path, work: Path) -> None:
    """Records a hundred simulated frames through librealsense's software device, and replays them into the example."""
    fresh = environment(python, work / "realsense")
    pip = [str(fresh), "-m", "pip", "install", "-q", "--disable-pip-version-check", "--only-binary", ":all:"]
    if subprocess.run([*pip, wheel, "pillow", "pyrealsense2"]).returncode or subprocess.run([fresh, "-c", "import pyrealsense2"]).returncode:
        return skip("example: a RealSense camera", "pyrealsense2 cannot be had, or lacks libusb-1.0")
    record = HERE.parent / "tools" / "recordings" / "software_realsense.py"
    if not check("a RealSense recording", [fresh, record, work / "room", work / "room.db3", "100"]):
        return None
    command = [str(fresh), str(HERE / "examples" / "realsense.py"), str(work / "room.db3")]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    tracked = sum(": tracked" in line or ": initialised" in line for line in done.stdout.splitlines())
    holds("example: a RealSense camera", done.returncode == 0 and tracked == 100, f"{tracked} of 100 frames with a pose")
    if tracked != 100:
        print(done.stdout)
    return None


def here(wheel: Path, work: Path) -> None:
    """Checks with this Python and its packages; the wheel is unpacked, not installed."""
    with zipfile.ZipFile(wheel) as file:
        file.extractall(work / "site")
    env = {**os.environ, "PYTHONPATH": str(work / "site"), "STILLPOINT_CASES": "200", "PYTHONDONTWRITEBYTECODE": "1"}
    check("docstrings", [sys.executable, "-m", "doctest", "-o", "ELLIPSIS", HERE / "tests" / "docstrings.py"], env=env, cwd=work)
    if all(importlib.util.find_spec(m) for m in ("pytest", "hypothesis")):
        check("tests", [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", HERE / "tests"], env=env, cwd=work)
    else:
        skip("tests", "pytest or hypothesis is not there")
    if importlib.util.find_spec("mypy"):
        types(Path(sys.executable), work)
    else:
        skip("types", "mypy is not there")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--here", action="store_true", help="with this Python and what it has; installs nothing")
    parser.add_argument("--profiles", type=Path, metavar="FILE", help="with --here: cargo's profile dev for the build (the root's Cargo.toml)")
    parser.add_argument("--build", type=Path, metavar="FOLDER", help="build the wheel into this folder, look at it, and end")
    parser.add_argument("--target", help="with --build: the platform to build for, as rustc names it (this one)")
    parser.add_argument("--wheel", type=Path, help="a wheel that is there; else it is built")
    parser.add_argument("--python", action="append", help="a version to check with, e.g. 3.12; may be repeated (all that are found)")
    parser.add_argument("--minutes", type=float, default=10.0, help="minutes of frames over which memory is watched (10)")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="stillpoint-python-") as temporary:
        work = Path(temporary)
        wheel = arguments.wheel.resolve() if arguments.wheel else None
        tools = Tools(work, may_install=not arguments.here) if wheel is None else None
        if tools is not None:
            folder = arguments.build.resolve() if arguments.build else work / "wheels"
            wheel = build(folder, tools, quick_profiles(arguments, work), arguments.target)
        is_local = tools is not None and not tools.has_zig
        if wheel is not None and arguments.build:
            look_at(wheel, is_local)
        elif wheel is not None and arguments.here:
            here(wheel, work)
        elif wheel is not None:
            look_at(wheel, is_local)
            everywhere(wheel, work, arguments)
    for reason in skipped:
        print(f"  skipped {reason}")
    print(f"python: {len(passed)} passed, {len(failed)} failed, {len(skipped)} skipped")
    return int(bool(failed))


def everywhere(wheel: Path, work: Path, arguments: argparse.Namespace) -> None:
    found = pythons()
    wanted = arguments.python or list(found)
    for version in ("3.11", "3.12", "3.13"):
        if version not in found:
            skip(f"Python {version}", "it is not on this machine")
    environments = {v: in_environment(v, found[v], wheel, work) for v in wanted if v in found}
    if environments:
        with_everything(environments[sorted(environments, key=VERSIONS.index)[-1]], work, arguments.minutes)
    # pyrealsense2 has wheels for some versions only.
    usable = [v for v in ("3.12", "3.11", "3.10") if v in environments]
    if usable:
        realsense(found[usable[-1] if "3.11" not in usable else "3.11"], wheel, work)
    else:
        skip("example: a RealSense camera", "no Python that pyrealsense2 has a wheel for")


if __name__ == "__main__":
    sys.exit(main())
