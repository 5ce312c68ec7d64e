#!/usr/bin/env python3
"""Measures what each constant of the method is worth: runs with half and with twice its value.

tools/constants/vary.py build WORK    copies the sources to WORK/sources, turns every numeric constant into a function that multiplies it by a
                                      factor from the environment, and builds the program (WORK/target)
tools/constants/vary.py run WORK      renders scenes, runs each constant x factor x input, and appends a line per run to WORK/runs.jsonl;
                                      continues a stopped run
tools/constants/vary.py rows WORK     writes lab/results/constants.jsonl, from which `lab constants` fills a column

Constants that a type, a pattern or another constant needs while compiling cannot be varied; the compiler finds them. STILLPOINT_DATA, else
../shared/data, has the recordings."""

import collections
import concurrent.futures
import hashlib
import json
import math
import os
import re
import shutil
import statistics
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("STILLPOINT_DATA", ROOT / "../shared/data")).resolve()
CRATES = ["crates/slam/src", "crates/estimation/src", "crates/features/src", "crates/detection/src"]
# As `lab constants`.
LISTED = ("crates/slam/src", "crates/estimation/src", "crates/features/src", "crates/detection/src/objects")
VISIBILITY = r"(?:pub(?:\([a-z]+\))?\s+)?"
NUMBER = re.compile(rf"^([ \t]*)({VISIBILITY})const\s+([A-Z][A-Z0-9_]*)\s*:\s*(f32|f64|u8|u16|u32|u64|usize|i32|i64)\s*=([^;]*);", re.M)
ANY = re.compile(rf"^[ \t]*{VISIBILITY}(?:const|static)\s+([A-Z][A-Z0-9_]*)\s*:", re.M)
USE = re.compile(r"((?:\b[A-Za-z_][A-Za-z0-9_]*::)*)\b([A-Z][A-Z0-9_]*)\b(?!\s*(?:\(|::|!|<))")
TESTS = re.compile(r"(?m)^\s*#\[cfg\((?:all\()?test(?:.*\n){1,2}?\s*mod \w+ \{")
# Comments, strings and imports stay unchanged.
KEPT = re.compile(rf'//[^\n]*|"(?:\\.|[^"\\])*"|(?m:^[ \t]*{VISIBILITY}use\s[^;]*;)')
VARIED = """
/// `value`, times the factor of `STILLPOINT_VARY` (`FILE:NAME=FACTOR`) if that names it.
fn vary_constant(name: &str, value: f64) -> f64 {
    let varied = std::env::var("STILLPOINT_VARY").ok();
    let factor = varied.as_ref().and_then(|v| v.split_once('=')).filter(|(n, _)| *n == name);
    factor.map_or(value, |(_, f)| value * f.parse::<f64>().unwrap())
}
"""
# Scene, frames (0: all), sensors.
SCENES = {"crowd_rpy_60": (90, ""), "loop_in_haste": (0, ""), "blocked_turn": (0, "--imu"), "blocked_walk": (0, "--odometry"), "walking_xyz": (150, "")}
SCENE_SEED = 1
NONE = "--detector none"
# Input: source, frames (0: all), options; {} is the folder of the source.
INPUTS = {
    "fr1_rpy_walkers": ("fr1_rpy_walkers", 110, NONE),
    "fr1_xyz_walkers": ("fr1_xyz_walkers", 100, NONE),
    "tartanair_office": ("tartanair_office", 70, NONE),
    "kitchen": ("kitchen", 80, NONE),
    "crowd_rpy_60": ("crowd_rpy_60", 0, NONE),
    "loop_in_haste": ("loop_in_haste", 0, NONE),
    "blocked_turn": ("blocked_turn", 0, NONE),
    "blocked_walk": ("blocked_walk", 0, NONE),
    "walking_xyz, paper": ("walking_xyz", 90, "--detector scripted:{}/detections.csv --set static_filter.preset=paper"),
    "walking_xyz, detector": ("walking_xyz", 120, "--detector scripted:{}/detections.csv"),
}
POSES = ["fr1_rpy_walkers", "crowd_rpy_60", "tartanair_office", "fr1_xyz_walkers", "kitchen"]
# Number of inputs for every constant; only those without effect run with the rest.
FIRST = 2
# Parts of file names, and the inputs to run; the first match counts.
WHERE = [
    (("detection/src/objects",), ["walking_xyz, detector"]),
    (("/looping/", "evidence.rs", "pose_graph", "sparse"), ["loop_in_haste"]),
    (("/inertial/",), ["blocked_turn"]),
    (("/odometry/",), ["blocked_walk"]),
    (("trust.rs", "known.rs", "carry.rs"), ["blocked_turn", "blocked_walk"]),
    (("paper.rs", "epipolar", "depth.rs", "fundamental", "degeneracy", "homography"), ["walking_xyz, paper"]),
    (("semantic.rs", "things.rs"), [*POSES, "walking_xyz, detector"]),
    (("/health/", "effort.rs", "pace.rs"), ["crowd_rpy_60", "tartanair_office"]),
]
SEEDS = 5


def inputs_of(constant):
    file = constant.split(":")[0]
    return next((inputs for parts, inputs in WHERE if any(p in file for p in parts)), POSES)


def product(text):
    """The text before its tests."""
    tests = TESTS.search(text)
    return text[: tests.start()] if tests else text


def rewrite(sources, excluded):
    """Copies the project and returns the constants that became functions. Unit tests are left out."""
    if sources.exists():
        shutil.rmtree(sources)
    shutil.copytree(ROOT, sources, ignore=shutil.ignore_patterns("target", ".git", "ros2", "python", "out"))
    constants = []
    for crate in CRATES:
        files = [p for p in sorted((ROOT / crate).rglob("*.rs")) if p.name != "tests.rs" and "tests" not in p.parts]
        texts = {str(p.relative_to(ROOT)): product(p.read_text()) for p in files}
        declared = collections.defaultdict(dict)
        for name, text in texts.items():
            for found in ANY.finditer(text):
                declared[found[1]][name] = False
            for found in NUMBER.finditer(text):
                declared[found[3]][name] = name.startswith(LISTED) and f"{name}:{found[3]}" not in excluded
        for name, text in texts.items():

            def varied(constant, path):
                places = declared.get(constant, {})
                if name in places and not (path.endswith("::") and not path.startswith("Self")):
                    return places[name]
                others = [v for place, v in places.items() if place != name or path]
                return bool(others) and all(others)

            def call(found):
                begun = re.search(r"const\s+$", found.string[max(0, found.start() - 8) : found.start()])
                return found[0] + ("()" if not begun and varied(found[2], found[1]) else "")

            def function(found):
                indent, visible, constant, kind, value = found.groups()
                if not declared[constant][name]:
                    return found[0]
                constants.append(f"{name}:{constant}")
                floor = "" if kind.startswith("f") else ".floor()"
                lazy = f'std::sync::LazyLock<{kind}> = std::sync::LazyLock::new(|| {{ let v: {kind} ={value}; '
                lazy += f'crate::vary_constant("{name}:{constant}", v as f64){floor} as {kind} }})'
                return f"{indent}#[allow(non_snake_case)] #[inline]\n{indent}{visible}fn {constant}() -> {kind} {{ static V: {lazy}; *V }}"

            pieces, at = [], 0
            for kept in KEPT.finditer(text):
                pieces += [USE.sub(call, text[at : kept.start()]), kept[0]]
                at = kept.end()
            pieces.append(USE.sub(call, text[at:]))
            end = VARIED if name == f"{crate}/lib.rs" else ""
            (sources / name).write_text(NUMBER.sub(function, "".join(pieces)) + end)
    return constants


def cargo(work, command):
    """The exit code, and the compiler's errors."""
    environment = dict(os.environ, CARGO_TARGET_DIR=str(work / "target"), RUSTFLAGS="--cap-lints allow")
    words = ["cargo", command, "--release", "--locked", "--bin", "stillpoint", "--message-format=json"]
    done = subprocess.run(words, cwd=work / "sources", env=environment, stdout=subprocess.PIPE, text=True)
    messages = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    errors = [m["message"] for m in messages if m.get("reason") == "compiler-message" and m["message"]["level"] == "error"]
    return done.returncode, errors


def build(work):
    excluded = set()
    while True:
        constants = rewrite(work / "sources", excluded)
        code, errors = cargo(work, "check")
        if code == 0:
            break
        named = {word for e in errors for s in e["spans"] for t in s["text"] for word in re.findall(r"\b[A-Z][A-Z0-9_]*\b", t["text"])}
        fixed = {c for c in constants if c.split(":")[1] in named}
        if not fixed:
            sys.exit("expected errors at constants, found: " + "".join(e["rendered"] for e in errors)[:2000])
        excluded |= fixed
        print(f"{len(excluded)} constants cannot be varied", flush=True)
    if cargo(work, "build")[0]:
        sys.exit("the build failed")
    (work / "constants.json").write_text(json.dumps(constants))
    print(f"{len(constants)} constants can be varied")


def source(work, name):
    """Folder of a recording or a scene; renders missing scenes."""
    if name not in SCENES:
        return DATA / name
    folder, (frames, sensors) = work / "scenes" / name, SCENES[name]
    if not folder.exists():
        limit = ["--frames", str(frames)] if frames else []
        words = [work / "target/release/stillpoint", "-q", "simulate", "--scene", name, "--seed", str(SCENE_SEED), "--out", folder]
        subprocess.run([*words, *limit, *sensors.split()], check=True)
    return folder


def ates(tree):
    for key, value in tree.items():
        if key == "ate":
            yield value["rmse"]
        elif isinstance(value, dict):
            yield from ates(value)


def run_once(work, constant, factor, name, seed):
    origin, frames, options = INPUTS[name]
    folder = source(work, origin)
    program = work / "target/release/stillpoint"
    key = hashlib.sha1(f"{constant}{factor}{name}{seed}".encode()).hexdigest()[:12]
    out, objects = work / f"run-{key}", work / f"objects-{key}.csv"
    words = [program, "-q", "run", folder, "--no-report", "--out", out, "--seed", str(seed), *options.replace("{}", str(folder)).split()]
    words += ["--max-frames", str(frames)] if frames else []
    words += ["--objects", objects] if name.endswith("detector") else []
    environment = dict(os.environ, STILLPOINT_VARY=f"{constant}={factor}")
    row = {"const": constant, "factor": factor, "input": name, "seed": seed}
    try:
        done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=300)
        summary = json.loads((out / "summary.json").read_text())
        poses = b"".join((out / f).read_bytes() for f in ("trajectory.txt", "trajectory_online.txt", "frames.csv"))
        poses += objects.read_bytes() if objects.exists() else b""
        row |= {"ate": list(ates(summary))[:2], "lost": summary["frames"] - summary["tracked"], "loops": summary["loops"]["closed"]}
        row["poses"] = hashlib.sha1(poses).hexdigest()[:12]
        if objects.exists():
            words = [program, "eval", "--objects", objects, folder / "boxes.csv", "--json"]
            row["score"] = json.loads(subprocess.run(words, capture_output=True, text=True).stdout)
    except subprocess.TimeoutExpired:
        row["error"] = "longer than 300 s"
    except OSError:
        row["error"] = done.stderr[-300:]
    shutil.rmtree(out, ignore_errors=True)
    objects.unlink(missing_ok=True)
    return row


def read(work):
    file = work / "runs.jsonl"
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def run(work):
    constants = json.loads((work / "constants.json").read_text())
    tasks = [("", 1, name, seed) for name in INPUTS for seed in range(SEEDS)]
    # Constants with the most inputs first.
    constants.sort(key=lambda c: len(inputs_of(c)), reverse=True)
    tasks += [(c, factor, name, 0) for c in constants for factor in (0.5, 2) for name in inputs_of(c)[:FIRST]]
    for name, _, _ in INPUTS.values():
        source(work, name)
    carry_out(work, tasks)
    seen = effects(work)
    quiet = [c for c in constants if not any(seen.get(c, {}).values())]
    carry_out(work, [(c, factor, name, 0) for c in quiet for factor in (0.5, 2) for name in inputs_of(c)[FIRST:]])


def carry_out(work, tasks):
    done = {(r["const"], r["factor"], r["input"], r["seed"]) for r in read(work)}
    left = [t for t in tasks if t not in done]
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool, (work / "runs.jsonl").open("a") as file:
        for i, row in enumerate(pool.map(lambda t: run_once(work, *t), left)):
            file.write(json.dumps(row) + "\n")
            file.flush()
            if i % 100 == 99:
                print(f"{i + 1} of {len(left)} runs, {time.strftime('%T')}", flush=True)


def figures(row):
    """Figures of a run that are better when smaller, by name."""
    found = dict(zip(("final", "online"), row.get("ate", [])))
    if row.get("score"):
        found["1 - HOTA"] = 1 - (row["score"]["score"]["hota"] or 0)
    return found


def effects(work):
    """By constant and factor: inputs whose figures leave the range of the seeds, as (input, figure, ratio to the median seed)."""
    rows, base = read(work), collections.defaultdict(list)
    for row in rows:
        if not row["const"]:
            base[row["input"]].append(row)
    found = collections.defaultdict(lambda: {0.5: [], 2: []})
    for row in rows:
        if not row["const"]:
            continue
        changed, known = found[row["const"]][row["factor"]], base[row["input"]]
        if "error" in row:
            changed.append((row["input"], "failed", None))
            continue
        if row["lost"] > max(r["lost"] for r in known):
            changed.append((row["input"], "lost", row["lost"]))
        if row["loops"] < min(r["loops"] for r in known):
            changed.append((row["input"], "loops", row["loops"]))
        for name, value in figures(row).items():
            seeds = [figures(r)[name] for r in known]
            low, high, middle = min(seeds), max(seeds), statistics.median(seeds)
            # A margin of half the seeds' range.
            if not low - 0.5 * (high - low) <= value <= high + 0.5 * (high - low):
                changed.append((row["input"], name, value / middle))
    return found


def rows(work):
    """Writes the largest effect of each constant, with half and with twice its value."""
    runs, lines = read(work), []
    base = {r["input"]: r["poses"] for r in runs if not r["const"] and r["seed"] == 0}
    same = collections.defaultdict(list)
    for row in runs:
        if row["const"]:
            same[row["const"]].append(row.get("poses") == base[row["input"]])
    for constant, changed in sorted(effects(work).items()):
        said = []
        for factor, word in ((0.5, "halved"), (2, "doubled")):
            failed = [f"{name} {figure}" for name, figure, _ in changed[factor] if figure in ("failed", "lost", "loops")]
            ratios = [c for c in changed[factor] if c[1] not in ("failed", "lost", "loops")]
            worst = max(ratios, key=lambda c: abs(math.log(max(c[2], 1e-9))), default=None)
            said += [f"{word}: " + ", ".join([*failed[:1], *([f"{worst[0]} {worst[1]} {worst[2]:.2f}"] if worst else [])])] if changed[factor] else []
        effect = "; ".join(said) or ("nothing" if all(same[constant]) else "within seeds")
        lines.append({"kind": "row", "cells": [*constant.split(":"), effect]})
    made = {"kind": "made", "command": "tools/constants/vary.py", "commit": commit(), "machine": f"{os.cpu_count()} cores", "seeds": f"0 to {SEEDS - 1}"}
    out = ROOT / "lab/results/constants.jsonl"
    out.write_text("".join(json.dumps(line, separators=(",", ":")) + "\n" for line in [made, *lines]))


def commit():
    return subprocess.run(["git", "rev-parse", "--short=12", "HEAD"], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout.strip()


COMMANDS = {"build": build, "run": run, "rows": rows}


def main():
    if len(sys.argv) != 3 or sys.argv[1] not in COMMANDS:
        sys.exit(__doc__)
    work = Path(sys.argv[2]).resolve()
    work.mkdir(parents=True, exist_ok=True)
    COMMANDS[sys.argv[1]](work)


if __name__ == "__main__":
    main()
