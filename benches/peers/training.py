"""Training steps and predictions beside PyTorch's, on the same meshes, in one run.

    python3 -m venv /tmp/peers && /tmp/peers/bin/pip install -r benches/peers/requirements.txt
    /tmp/peers/bin/python benches/peers/training.py [--rounds N] [--steps N] [--steps-binary FILE] [--vertices N]

The same on both sides: the meshes, their features, W, L and B; the trunk (encoder of 3 inputs, four layers, sine, (29) or
`pointwise`); single precision; the Rayleigh quotient of the whole batch, deflated against the constant of every mesh; its gradient with
respect to every weight; Adam. Different: PyTorch's head is one more trained weight, ours is solved on the batch in every step (Gram
matrices and an eigenproblem, in double precision), so PyTorch has less to do. A batch is one tall matrix with a
block-diagonal W there. A prediction is a forward pass with 16 heads on a sphere of 10,242 vertices.

Both sides run as processes of their own, by turns; the least time of each is kept, and PyTorch's best is the better of eager and
compiled. Prints a Markdown table.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
import time

from common import build, child

CASES = [("sggc", 10, 144, 128, 1), ("sggc", 10, 144, 128, 3), ("sggc", 1, 500, 256, 1), ("sggc", 1, 500, 256, 3),
         ("pointwise", 10, 144, 128, 1), ("pointwise", 1, 500, 256, 1)]


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--rounds", type=int, default=3)
    arguments.add_argument("--steps", type=int, default=40)
    arguments.add_argument("--steps-binary", help="our side, already built")
    arguments.add_argument("--no-compile", action="store_true")
    arguments.add_argument("--vertices", type=int, help="only the rows of meshes with so many")
    options = arguments.parse_args()
    ours = options.steps_binary or build("steps")
    modes = ["eager"] if options.no_compile else ["eager", "compile"]
    print("| layer | batch | I | threads | ours, ms | of it products | eager, ms | compiled, ms | ratio | "
          "prediction: ours, ms | PyTorch, ms | ratio |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for case in (case for case in CASES if options.vertices in (None, case[2])):
            rows(case, ours, modes, folder, options)


def rows(case, ours, modes, folder, options):
    layer, members, vertices, width, iterations = case
    data = f"{folder}/{members}x{vertices}.json"
    subprocess.run([ours, "data", str(members), str(vertices), data], check=True)
    for threads in (1, 2):
        mine, theirs = [], {mode: [] for mode in modes}
        for _ in range(options.rounds):
            run = ["run", *map(str, (layer, members, vertices, width, iterations, threads, options.steps))]
            mine.append(child([ours, *run]))
            for mode in modes:
                peer = [data, layer, width, iterations, threads, options.steps, mode]
                theirs[mode].append(child([sys.executable, __file__, "--peer", *map(str, peer)]))
        least = lambda runs, what: min(run[what] for run in runs)
        step, prediction = least(mine, "least"), least(mine, "prediction")
        steps = [least(theirs[mode], "least") for mode in modes] + [float("nan")] * (2 - len(modes))
        best = min(least(theirs[mode], "least") for mode in modes)
        predicted = min(least(theirs[mode], "prediction") for mode in modes)
        print(f"| {layer} | {members} × {vertices}, h {width} | {iterations} | {threads} | {step:.1f} | "
              f"{100 * least(mine, 'products') / step:.0f} % | {steps[0]:.1f} | {steps[1]:.1f} | {best / step:.1f} | "
              f"{prediction:.1f} | {predicted:.1f} | {predicted / prediction:.1f} |", flush=True)


def peer(data, layer, width, iterations, threads, steps, mode):
    import torch

    torch.set_num_threads(threads)
    torch.manual_seed(0)
    document = json.loads(pathlib.Path(data).read_text())

    class Product(torch.autograd.Function):
        """A x for a sparse A whose transpose is at hand: faster than what autograd makes of it."""

        @staticmethod
        def forward(context, matrix, transpose, x):
            context.transpose = transpose
            return matrix @ x

        @staticmethod
        def backward(context, gradient):
            return None, None, context.transpose @ gradient

    def sparse(rows, columns, values, n):
        index = torch.tensor([rows, columns])
        matrix = torch.sparse_coo_tensor(index, torch.tensor(values, dtype=torch.float32), (n, n))
        return matrix.coalesce().to_sparse_csr(), matrix.t().coalesce().to_sparse_csr()

    def batch(members):
        """One tall matrix of features, and block-diagonal W, L and B, with the mesh of every vertex."""
        features, mesh, start = [], [], 0
        entries = {name: ([], [], []) for name in ("adjacency", "stiffness", "mass")}
        for number, member in enumerate(members):
            n = len(member["neighbours"])
            lists = {name: member[name] for name in ("stiffness", "mass")}
            lists["adjacency"] = [(i, j, 1 / len(row)) for i, row in enumerate(member["neighbours"]) for j in row]
            for name, (rows, columns, values) in entries.items():
                for i, j, value in lists[name]:
                    rows.append(start + i), columns.append(start + j), values.append(value)
            features += member["features"]
            mesh += n * [number]
            start += n
        matrices = {name: sparse(*lists, start) for name, lists in entries.items()}
        return torch.tensor(features).reshape(start, -1), torch.tensor(mesh), matrices

    x, mesh, matrices = batch(document["members"])
    stiffness, mass = matrices["stiffness"], matrices["mass"]
    areas = mass[0] @ torch.ones(len(x), 1)
    uniform = lambda *size, reach: torch.nn.Parameter((2 * torch.rand(*size) - 1) * reach)
    encoder, phases = uniform(width, 3, reach=4.0), uniform(width, reach=3.14159)
    first = [uniform(width, width, reach=0.005) for _ in range(4)]
    second = [uniform(width, width, reach=0.005) for _ in range(4)] if layer == "sggc" else []
    head = uniform(width, 1, reach=0.1)
    optimiser = torch.optim.Adam([encoder, phases, *first, *second, head], lr=6e-3, fused=True)
    total = torch.zeros(len(document["members"]), 1)

    def trunk(x, adjacency):
        x = torch.sin(torch.nn.functional.linear(x, encoder, phases))
        for number, w1 in enumerate(first):
            for _ in range(iterations):
                if second:
                    laplacian = x - Product.apply(*adjacency, x)
                    x = x - torch.nn.functional.linear(x, w1) - 2 * torch.nn.functional.linear(laplacian, second[number])
                else:
                    x = x - torch.nn.functional.linear(x, w1)
            x = torch.sin(x)
        return x

    def quotient():
        u = trunk(x, matrices["adjacency"]) @ head
        # The B-mean of every mesh, whose area is 1.
        u = u - total.index_add(0, mesh, areas * u)[mesh]
        return (u * Product.apply(*stiffness, u)).sum() / (u * Product.apply(*mass, u)).sum()

    compiled = torch.compile(quotient) if mode == "compile" else quotient
    heads = torch.rand(width, 16)

    def step():
        optimiser.zero_grad()
        compiled().backward()
        optimiser.step()

    def least(work, count):
        times = []
        for _ in range(count):
            started = time.perf_counter()
            work()
            times.append(1e3 * (time.perf_counter() - started))
        return min(times)

    least(step, 5)
    step_ms = least(step, steps)
    points, _, sphere = batch([document["prediction"]])
    predicting = torch.compile(trunk) if mode == "compile" else trunk

    def predict():
        with torch.no_grad():
            return predicting(points, sphere["adjacency"]) @ heads

    least(predict, 2)
    print(json.dumps({"least": step_ms, "prediction": least(predict, 10)}))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--peer"]:
        data, layer, *numbers, mode = sys.argv[2:]
        peer(data, layer, *map(int, numbers), mode)
    else:
        main()
