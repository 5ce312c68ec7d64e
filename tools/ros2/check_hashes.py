"""Compares the hashes of `stillpoint-ros2 --types` with those of PyPI's ros2_pyterfaces 0.3 (with cyclonedds and cyclonedds-idl), which
lacks vision_msgs and tf2_msgs.

usage: check_hashes.py STILLPOINT_ROS2; with --list instead, prints the compared hashes
"""
import importlib
import subprocess
import sys


def known(name):
    package, kind, message = name.split("/")
    try:
        module = importlib.import_module(f"ros2_pyterfaces.cyclone.{package}.{kind}")
        return getattr(module, message).hash_rihs01()
    except (ImportError, AttributeError):
        return None


def main():
    if sys.argv[1] == "--list":
        rows = [(n, None) for n in sys.argv[2:]]
    else:
        rows = [r.split() for r in subprocess.check_output([sys.argv[1], "--types"], text=True).splitlines()]
    bad = compared = 0
    for name, own in rows:
        other = known(name)
        if sys.argv[1] == "--list":
            print(name, other)
        elif other is None:
            print(f"not compared: {name}")
        else:
            compared += 1
            bad += own != other
            print("equal" if own == other else f"DIFFERENT: {own} {other}", name)
    print(f"{compared} compared, {bad} different")
    sys.exit(bool(bad))


if __name__ == "__main__":
    main()
