"""What every comparison with a peer does: build our side, and run either side as a process of its own."""

import json
import pathlib
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[2]


def child(command):
    """What a process prints, read as JSON."""
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def build(bench):
    """The path of our side, built."""
    command = ["cargo", "bench", "--bench", bench, "--no-run", "--message-format=json"]
    built = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout
    messages = (json.loads(line) for line in built.splitlines() if line.startswith("{"))
    return next(m["executable"] for m in messages if m.get("executable") and m["target"]["name"] == bench)
