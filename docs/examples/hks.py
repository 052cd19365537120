"""The heat kernel signature from eigen.npz, with numpy alone.

    python docs/examples/hks.py out/sphere.obj

Where descriptors.npz lies beside it (publish.descriptors = ["hks"]), the two are compared.
"""

import sys
from pathlib import Path

import numpy as np

folder = Path(sys.argv[1])
eigen = np.load(folder / "eigen.npz")
evals, evecs, mass = eigen["evals"], eigen["evecs"], eigen["mass"]

# Eigenvalues of 0, one for every piece, have no frequency: the times begin after them.
positive = evals[evals > 1e-6 / mass.sum()]
times = np.geomspace(4 * np.log(10) / positive.max(), 4 * np.log(10) / positive.min(), 100)

# k_t(x, x) = Σ exp(−λ_k t) φ_k(x)², one row a vertex, one column a time.
hks = evecs**2 @ np.exp(-np.outer(evals, times))
heat_trace = np.exp(-np.outer(evals, times)).sum(axis=0)
print(f"{hks.shape[0]} vertices, {hks.shape[1]} times from {times[0]:.4g} to {times[-1]:.4g}")

beside = folder / "descriptors.npz"
if beside.exists():
    theirs = np.load(beside)
    print(f"times: {np.abs(theirs['hks_times'] / times - 1).max():.1e} apart")
    print(f"hks: {np.abs(theirs['hks'] / hks - 1).max():.1e} apart")
    print(f"scaled: {np.abs(theirs['hks_scaled'] / (hks / heat_trace) - 1).max():.1e} apart")
