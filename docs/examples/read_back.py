"""Reads the files of a mesh with the programs that people use, and holds them against eigen.npz.

    python docs/examples/read_back.py out/sphere.obj

Every file that is there (publish.formats) is read by another library: meshio (PLY, VTU), PyVista, which is VTK itself (VTK, VTU),
SciPy (MAT, NPZ of the matrices, Matrix Market), json and csv. What is not installed is passed over. Ends with 1 when a number differs.
"""

import csv
import json
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np

folder = Path(sys.argv[1])
eigen = np.load(folder / "eigen.npz")
evals, evecs, vertices, faces = (eigen[name] for name in ("evals", "evecs", "vertices", "faces"))
names = [f"phi_{k}" for k in range(1, len(evals) + 1)]
wrong = []


def compare(file, reader, pairs):
    """Largest differences of arrays that should be equal."""
    worst = 0.0
    for theirs, ours in pairs:
        theirs, ours = np.asarray(theirs), np.asarray(ours)
        same = theirs.shape == ours.shape
        worst = np.maximum(worst, np.abs(theirs - ours).max() if same else np.inf)
    say(file, reader, worst)


def say(file, reader, worst):
    print(f"{file:20} {reader:8} largest difference {worst:.1e}")
    # What is not a number is not the same one.
    if not worst == 0:
        wrong.append(file)


def each(reader, *files):
    """Those of the files that are there, if the reader is."""
    module = {"PyVista": "pyvista", "SciPy": "scipy", "meshio": "meshio"}.get(reader, reader)
    there = [file for file in files if (folder / file).exists()]
    if there and find_spec(module) is None:
        print(f"skipped: {reader} is not installed, which reads {', '.join(there)}")
        return []
    return there


for file in each("meshio", "eigen.ply", "eigen.vtu"):
    import meshio

    mesh = meshio.read(folder / file)
    functions = np.column_stack([mesh.point_data[name] for name in names])
    compare(file, "meshio", [(mesh.points, vertices), (mesh.cells_dict["triangle"], faces), (functions, evecs)])

for file in each("PyVista", "eigen.vtk", "eigen.vtu"):
    import pyvista

    mesh = pyvista.read(folder / file)
    functions = np.column_stack([mesh.point_data[name] for name in names])
    corners = mesh.faces if file.endswith("vtk") else mesh.cells
    corners = corners.reshape(-1, 4)[:, 1:]
    compare(
        file,
        "PyVista",
        [(mesh.points, vertices), (corners, faces), (functions, evecs), (mesh.field_data["lambda"], evals)],
    )

for file in each("SciPy", "eigen.mat"):
    from scipy.io import loadmat

    mat = loadmat(folder / file)
    compare(
        file,
        "SciPy",
        [(mat["evals"][:, 0], evals), (mat["evecs"], evecs), (mat["vertices"], vertices), (mat["faces"] - 1.0, faces)],
    )

for file in each("json", "eigen.json"):
    document = json.loads((folder / file).read_text())
    compare(file, "json", [(document["eigenvalues"], evals), (np.transpose(document["eigenvectors"]), evecs)])

for file in each("csv", "spectrum.csv"):
    rows = list(csv.DictReader((folder / file).open()))
    compare(file, "csv", [([float(row["lambda_refined"] or row["lambda"]) for row in rows], evals)])

for file in each("SciPy", "stiffness.npz", "mass.npz", "graph_laplacian.npz"):
    from scipy.io import mmread
    from scipy.sparse import load_npz

    matrix = load_npz(folder / file)
    text = folder / file.replace(".npz", ".mtx")
    if text.exists():
        say(text.name, "SciPy", abs(mmread(text).tocsr() - matrix).max())

if {"stiffness.npz", "mass.npz"} <= {file.name for file in folder.iterdir()} and find_spec("scipy"):
    from scipy.sparse import load_npz

    stiffness, mass = (load_npz(folder / f"{name}.npz") for name in ("stiffness", "mass"))
    residual = np.abs(stiffness @ evecs - mass @ evecs * evals).max()
    # What was learned is no solution to the last digit.
    sources = {pair["source"] for pair in json.loads((folder / "spectrum.json").read_text())["eigenpairs"]}
    if sources <= {"constant", "fem"} and not residual < 1e-8 * np.abs(stiffness).max() * np.abs(evecs).max():
        wrong.append("stiffness, mass")
    print(f"{'stiffness, mass':20} {'SciPy':8} max |Lφ − λBφ| {residual:.1e}")

sys.exit(f"differs: {', '.join(wrong)}" if wrong else 0)
