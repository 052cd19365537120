"""The eigensolver beside SciPy's, on the same matrices, in one run.

    python3 -m venv /tmp/peers && /tmp/peers/bin/pip install -r benches/peers/requirements.txt
    /tmp/peers/bin/python benches/peers/eigsh.py [--repeat N] [--spot FILE] [CASE…]

SciPy runs `eigsh(L, K, M=B, sigma=-0.01)`: ARPACK in shift-invert mode over SuperLU, which is what LaPy and pyFM do. Both
sides run as processes of their own, by turns, and time the solver alone; ours includes the count by inertia, SciPy has
none. Prints a Markdown table of medians.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

from common import ROOT, build, child

SPHERES = {"sphere 10k": "sphere:5", "sphere 40k": "sphere:6", "sphere 160k": "sphere:7"}


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("cases", nargs="*", help="some of: " + ", ".join(SPHERES) + ", spot")
    arguments.add_argument("--repeat", type=int, default=3)
    arguments.add_argument("--spot", help="a mesh for the case 'spot'", default=str(ROOT / "../shared/data/spot_11533.obj"))
    arguments.add_argument("-k", type=int, action="append")
    options = arguments.parse_args()
    meshes = dict(SPHERES)
    if pathlib.Path(options.spot).exists():
        meshes["spot"] = options.spot
    else:
        print(f"no {options.spot}: the case 'spot' is left out", file=sys.stderr)
    solver = build("solver")
    print("| mesh | vertices | K | chladni s | SciPy s | ratio | chladni MiB | SciPy MiB | largest relative difference |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in options.cases or meshes:
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([solver, "matrices", meshes[name], folder], check=True)
            for k in options.k or [50, 100]:
                row(name, solver, meshes[name], folder, k, options.repeat)


def row(name, solver, mesh, folder, k, repeat):
    ours, theirs = [], []
    for _ in range(repeat):
        ours.append(child([solver, "solve", mesh, str(k)]))
        theirs.append(child([sys.executable, __file__, "--eigsh", folder, str(k)]))
    assert all(run["complete"] for run in ours), "the count by inertia does not agree"
    pairs = list(zip(ours[0]["eigenvalues"], theirs[0]["eigenvalues"]))[1:]
    difference = max(abs(a - b) / b for a, b in pairs)
    seconds = [statistics.median(run["seconds"] for run in runs) for runs in (ours, theirs)]
    ratio = statistics.median(b["seconds"] / a["seconds"] for a, b in zip(ours, theirs))
    memory = [max(run["peak_kib"] for run in runs) / 1024 for runs in (ours, theirs)]
    print(f"| {name} | {ours[0]['n']:,} | {k} | {seconds[0]:.2f} | {seconds[1]:.2f} | {ratio:.1f} | "
          f"{memory[0]:.0f} | {memory[1]:.0f} | {difference:.0e} |", flush=True)


def eigsh(folder, k):
    import resource
    import time

    import numpy
    import scipy.sparse
    import scipy.sparse.linalg

    def matrix(name):
        parts = [numpy.load(f"{folder}/{name}_{part}.npy") for part in ("data", "indices", "indptr")]
        return scipy.sparse.csr_matrix(tuple(parts)).tocsc()

    stiffness, mass = matrix("L"), matrix("B")
    started = time.perf_counter()
    values, _ = scipy.sparse.linalg.eigsh(stiffness, k, M=mass, sigma=-0.01)
    seconds = time.perf_counter() - started
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps({"seconds": seconds, "eigenvalues": sorted(values), "peak_kib": peak}))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--eigsh"]:
        eigsh(sys.argv[2], int(sys.argv[3]))
    else:
        main()
