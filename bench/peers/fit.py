"""Fits of `rsm fit` beside those of numpy, statsmodels, polars, duckdb and scikit-learn, in one run.

In: the command `rsm`, a folder for files, the number of rows of the large table, the number of random surfaces. Out: four tables. Every fit of
`rsm` is one call of the command, reading and writing of files included. Data are drawn from fixed seeds.

    python fit.py RSM FOLDER ROWS SURFACES
    python fit.py --peer NAME FILE        one fit of the large table, in a process of its own
"""

import json
import os
import subprocess
import sys
import tomllib
import warnings
from fractions import Fraction
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np


def powers(inputs, order):
    """The powers of every term up to an order."""
    found = [(0,) * inputs]
    for degree in range(1, order + 1):
        for chosen in combinations_with_replacement(range(inputs), degree):
            found.append(tuple(chosen.count(k) for k in range(inputs)))
    return found


def columns(x, terms):
    return np.stack([np.prod([x[:, k] ** p for k, p in enumerate(term)], axis=0) for term in terms], axis=1)


class Rsm:
    """The command, with a folder for its files."""

    def __init__(self, program, folder):
        self.program, self.folder = program, Path(folder)

    def write(self, name, x, y):
        head = ",".join([f"x{k}[-]" for k in range(x.shape[1])] + ["y[-]"])
        table = np.column_stack([x, y])
        np.savetxt(self.folder / name, table, fmt="%.17g", delimiter=",", header=head, comments="")

    def specify(self, name, ranges, select, data):
        """Writes a specification of one response."""
        inputs = "".join(f"[inputs.x{k}]\nunit = \"-\"\nrange = [{float(a)}, {float(b)}]\n" for k, (a, b) in enumerate(ranges))
        names = ", ".join(f'"x{k}"' for k in range(len(ranges)))
        text = f'format = 1\nmodel = "m"\ndata = ["{data}"]\n{inputs}[responses.y]\nunit = "-"\ninputs = [{names}]\n{select}\n'
        (self.folder / f"{name}.toml").write_text(text)

    def fit(self, name, ranges, select, data):
        """The model, as TOML, and the figures of its fit."""
        self.specify(name, ranges, select, data)
        call = [self.program, "fit", f"{name}.toml", "--out", f"{name}.model.toml", "--json", "--force"]
        done = subprocess.run(call, cwd=self.folder, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"rsm fit {name}: {done.stderr}")
        model = tomllib.loads((self.folder / f"{name}.model.toml").read_text())
        return model, json.loads(done.stdout)["responses"]["y"]

    def evaluate(self, name, x):
        head = ",".join(f"x{k}[-]" for k in range(x.shape[1]))
        np.savetxt(self.folder / "at.csv", x, fmt="%.17g", delimiter=",", header=head, comments="")
        call = [self.program, "eval", f"{name}.model.toml", "--data", "at.csv", "--json"]
        done = subprocess.run(call, cwd=self.folder, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"rsm eval {name}: {done.stderr}")
        return np.array(json.loads(done.stdout)["values"])


# --- digits of coefficients


def digits(found, wanted):
    """The number of correct decimal digits of the worst coefficient, as NIST counts them."""
    worst = max(abs(float((Fraction(a) - b) / b)) for a, b in zip(found, wanted))
    return 16.0 if worst == 0.0 else min(16.0, -np.log10(worst))


def raw(model):
    """Coefficients of powers of the input, from those of the coded input, in exact arithmetic."""
    low, high = (Fraction(value) for value in model["inputs"]["x0"]["range"])
    centre, half = (low + high) / 2, (high - low) / 2
    terms = {term["powers"][0]: Fraction(term["coefficient"]) for term in model["surfaces"]["y"]["terms"]}
    total, power = [Fraction(0)], [Fraction(1)]
    for k in range(max(terms) + 1):
        if k:
            # times (x - centre)/half
            shifted = [Fraction(0)] + power
            power = [(a - centre * b) / half for a, b in zip(shifted, power + [Fraction(0)])]
        total += [Fraction(0)] * (len(power) - len(total))
        for place, value in enumerate(power):
            total[place] += terms.get(k, 0) * value
    return total


def digits_table(rsm):
    import statsmodels.api as sm

    print("\ncorrect digits of the worst coefficient of a polynomial; every value in the table is exact in double precision\n")
    print(f"{'':34}| {'rsm fit':>8} {'numpy':>8} {'statsmodels':>12}")
    cases = [
        # Wampler1 of NIST's Statistical Reference Datasets: all coefficients are 1.
        ("Wampler1: order 5, x from 0 to 20", [float(x) for x in range(21)], 5),
        ("order 6, x from -9 to -3 by 1/8", [-9 + k / 8 for k in range(49)], 6),
        ("order 7, x from -9 to -3 by 1/8", [-9 + k / 8 for k in range(49)], 7),
    ]
    for number, (words, x, order) in enumerate(cases):
        y = [sum(Fraction(value) ** k for k in range(order + 1)) for value in x]
        assert all(Fraction(float(value)) == value for value in y)
        x, y = np.array(x)[:, None], np.array([float(value) for value in y])
        rsm.write(f"digits-{number}.csv", x, y)
        select = f'select = {{ method = "fixed", order = {order} }}'
        model, _ = rsm.fit(f"digits-{number}", [(x.min(), x.max())], select, f"digits-{number}.csv")
        design = columns(x, powers(1, order))
        ones = [Fraction(1)] * (order + 1)
        own = digits(raw(model), ones)
        numpy = digits(np.linalg.lstsq(design, y, rcond=None)[0].tolist(), ones)
        statsmodels = digits(sm.OLS(y, design).fit().params.tolist(), ones)
        print(f"{words:34}| {own:>8.1f} {max(numpy, 0.0):>8.1f} {max(statsmodels, 0.0):>12.1f}")


# --- a large table

TERMS = powers(3, 2)


def solved(sums):
    """Coefficients from the products of all terms and the response."""
    sums = np.array(sums, dtype=float)
    return np.linalg.solve(sums[:-1, :-1], sums[:-1, -1])


def in_sql(term):
    return "*".join(["1.0"] + [f'"x{k}[-]"' for k, p in enumerate(term) for _ in range(p)])


def peer(name, file):
    """One fit of the large table. Prints its coefficients."""
    if name == "polars":
        import polars as pl

        table = pl.scan_csv(file)
        terms = []
        for term in TERMS:
            product = pl.lit(1.0)
            for k, p in enumerate(term):
                for _ in range(p):
                    product = product * pl.col(f"x{k}[-]")
            terms.append(product)
        terms.append(pl.col("y[-]"))
        n = len(terms)
        each = [(terms[i] * terms[j]).sum().alias(f"{i}-{j}") for i in range(n) for j in range(i, n)]
        found = table.select(each).collect(engine="streaming").row(0, named=True)
        # The product of two constants is one value.
        rows = table.select(pl.len()).collect().item()
        sums = [[found[f"{min(i, j)}-{max(i, j)}"] for j in range(n)] for i in range(n)]
        sums[0][0] = rows
    elif name == "duckdb":
        import duckdb

        terms = [in_sql(term) for term in TERMS] + ['"y[-]"']
        n = len(terms)
        each = ", ".join(f"sum({terms[i]}*{terms[j]})" for i in range(n) for j in range(i, n))
        found = iter(duckdb.sql(f"select {each} from read_csv('{file}')").fetchall()[0])
        sums = [[0.0] * n for _ in range(n)]
        for i in range(n):
            for j in range(i, n):
                sums[i][j] = sums[j][i] = next(found)
    else:
        table = np.loadtxt(file, delimiter=",", skiprows=1)
        print(json.dumps(np.linalg.lstsq(columns(table[:, :3], TERMS), table[:, 3], rcond=None)[0].tolist()))
        return
    print(json.dumps(solved(sums).tolist()))


# A process counts the memory of the process that started it, so a small one starts each and measures it.
STARTER = """
import json, os, subprocess, sys, time
begin = time.perf_counter()
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
text = process.stdout.read().decode()
_, status, usage = os.wait4(process.pid, 0)
print(json.dumps([time.perf_counter() - begin, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, text, status]))
"""


def timed(call, cwd):
    """Seconds, processor seconds and megabytes of a process, and what it prints."""
    done = subprocess.run([sys.executable, "-S", "-c", STARTER, *call], cwd=cwd, capture_output=True, text=True, check=True)
    *found, status = json.loads(done.stdout)
    if status:
        raise SystemExit(f"{call}: status {os.waitstatus_to_exitcode(status)}")
    return found


def large_table(rsm, rows):
    random = np.random.default_rng(1)
    file = rsm.folder / "large.csv"
    truth = random.normal(size=len(TERMS))
    with open(file, "w") as out:
        out.write("x0[-],x1[-],x2[-],y[-]\n")
        for first in range(0, rows, 100_000):
            x = np.round(random.uniform(-1, 1, (min(100_000, rows - first), 3)), 4)
            y = np.round(columns(x, TERMS) @ truth + random.normal(scale=0.1, size=len(x)), 6)
            np.savetxt(out, np.column_stack([x, y]), fmt=["%.4f"] * 3 + ["%.6f"], delimiter=",")
    print(f"\nten terms from a CSV file of {rows:,} rows ({file.stat().st_size / 1e6:.0f} MB): the sums of one pass\n")
    print(f"{'':24}| {'s':>7} {'CPU s':>7} {'MB':>7} | {'time to rsm':>11} | largest difference of a coefficient")
    rsm.specify("large", [(-1.0, 1.0)] * 3, 'select = { method = "fixed", order = 2 }', "large.csv")
    whole = [rsm.program, "fit", "large.toml", "--out", "large.model.toml", "--json", "--force"]
    part = [rsm.program, "fit", "large.toml", "--partial", "large.part", "--force"]
    first = timed(whole, rsm.folder)
    found = {tuple(it["powers"]): it["coefficient"] for it in json.loads(first[3])["responses"]["y"]["terms"]}
    own = np.array([found[term] for term in TERMS])
    lines = [("rsm fit", first, own), ("rsm fit --partial", timed(part, rsm.folder), None)]
    for name in ["polars", "duckdb", "numpy"]:
        if name == "numpy" and rows > 1_000_000:
            continue
        measured = timed([sys.executable, __file__, "--peer", name, str(file)], rsm.folder)
        lines.append((name, measured, np.array(json.loads(measured[3]))))
    for name, (seconds, cpu, megabytes, _), coefficients in lines:
        off = "" if coefficients is None else f"{np.max(np.abs(coefficients - own)):.0e}"
        print(f"{name:24}| {seconds:>7.2f} {cpu:>7.2f} {megabytes:>7.0f} | {seconds / first[0]:>11.2f} | {off}")
    file.unlink()


# --- honest selection


def selection_table(rsm, surfaces):
    from sklearn.linear_model import LassoCV
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    print(
        f"\n{surfaces} random surfaces: 1 to 6 inputs, 30 to 300 rows, a third of the terms up to order 3, noise 0.1 to 3 of the signal;\n"
        "error: root mean square on 4,000 fresh rows without noise; reported: the error stated for new rows, over the true one\n"
    )
    ours, theirs, reported = [], [], [[], []]
    for seed in range(surfaces):
        random = np.random.default_rng(100 + seed)
        inputs, rows = int(random.integers(1, 7)), int(np.exp(random.uniform(np.log(30), np.log(300))))
        terms = powers(inputs, 3)
        truth = random.normal(size=len(terms)) * (random.uniform(size=len(terms)) < 1 / 3)
        truth[1] += 1.0
        x, fresh = random.uniform(-1, 1, (rows, inputs)), random.uniform(-1, 1, (4000, inputs))
        design, wanted = columns(x, terms), columns(fresh, terms) @ truth
        noise = wanted.std() * np.exp(random.uniform(np.log(0.1), np.log(3)))
        y = design @ truth + random.normal(scale=noise, size=rows)
        rsm.write("select.csv", x, y)
        _, fit = rsm.fit("select", [(-1.0, 1.0)] * inputs, 'select = { method = "lasso", max_order = 3 }', "select.csv")
        error = np.sqrt(np.mean((rsm.evaluate("select", fresh) - wanted) ** 2))
        ours.append(error / noise)
        reported[0].append(fit["cross_validation"]["rmse"] / np.hypot(error, noise))
        lasso = make_pipeline(StandardScaler(), LassoCV(cv=10, max_iter=20_000))

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            lasso.fit(design[:, 1:], y)
        error = np.sqrt(np.mean((lasso.predict(columns(fresh, terms)[:, 1:]) - wanted) ** 2))
        theirs.append(error / noise)
        reported[1].append(np.sqrt(lasso[-1].mse_path_.mean(axis=1).min()) / np.hypot(error, noise))
    print(f"{'':14}| {'error, in noises: median':>25} {'mean':>6} | reported: median")
    for name, errors, told in [("rsm fit", ours, reported[0]), ("LassoCV", theirs, reported[1])]:
        print(f"{name:14}| {np.median(errors):>25.3f} {np.mean(errors):>6.3f} | {np.median(told):.3f}")
    print(f"rsm fit has at most the error of LassoCV on {np.mean(np.array(ours) <= np.array(theirs)):.0%} of the surfaces")


# --- maps


def friction(x):
    """Stribeck friction over speed and temperature."""
    v, t = x[:, 0], x[:, 1]
    level = 1.0 - 0.3 * t
    return np.tanh(v / 0.05) * (level + 0.6 * np.exp(-((v / 0.25) ** 2))) + 0.4 * v * (1.0 - 0.4 * t)


def flux(x):
    """Flux of a machine that saturates, with cross saturation."""
    d, q = x[:, 0], x[:, 1]
    return np.arctan(2.2 * (d + 0.3)) * (1.0 - 0.15 * q**2 / (1.0 + q**2)) + 0.1 * d


def torque(x):
    """Torque of an engine over speed, throttle and spark advance."""
    n, a, s = x[:, 0], x[:, 1], x[:, 2]
    air = 1.0 - np.exp(-2.5 * (a + 1.05) / (1.2 + 0.5 * n))
    return air * (1.0 - 0.25 * (n - 0.1) ** 2) * (1.0 - 0.2 * (s - 0.3 * n) ** 2) - 0.08 * (n + 1.5)


def maps_table(rsm):
    from sklearn.ensemble import GradientBoostingRegressor
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel


    print("\nmaps: error on 4,000 fresh points, % of the standard deviation; 300 points with a noise of 0.5 % of it\n")
    print(f"{'':10}| {'rsm fit':>8} {'coefficients':>12} {'GP':>8} {'boosting':>9} | {'rsm to GP':>9}  form")
    for name, law, inputs in [("friction", friction, 2), ("flux", flux, 2), ("torque", torque, 3)]:
        random = np.random.default_rng(7)
        x, fresh = random.uniform(-1, 1, (300, inputs)), random.uniform(-1, 1, (4000, inputs))
        wanted = law(fresh)
        scale = wanted.std()
        y = law(x) + random.normal(scale=0.005 * scale, size=len(x))
        rsm.write(f"{name}.csv", x, y)
        # Every form is tried, and cross-validation chooses.
        select = 'select = { method = "lasso", max_order = 6 }\nforms = ["polynomial", "sigmoid", "spline"]'
        model, _ = rsm.fit(name, [(-1.0, 1.0)] * inputs, select, f"{name}.csv")
        error = lambda found: 100 * np.sqrt(np.mean((found - wanted) ** 2)) / scale
        kernel = ConstantKernel(1.0) * RBF(np.ones(inputs)) + WhiteKernel(1e-4)
        process = GaussianProcessRegressor(kernel, normalize_y=True, n_restarts_optimizer=3, random_state=0)
        boosting = GradientBoostingRegressor(n_estimators=600, max_depth=3, learning_rate=0.05, random_state=0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            process.fit(x, y)
            boosting.fit(x, y)
        own, gp, trees = error(rsm.evaluate(name, fresh)), error(process.predict(fresh)), error(boosting.predict(fresh))
        surface = model["surfaces"]["y"]
        form = next((it for it in ["spline", "sigmoids"] if it in surface), "polynomial")
        count = len(surface["spline"]["coefficients"] if form == "spline" else surface["terms"])
        print(f"{name:10}| {own:>8.2f} {count:>12} {gp:>8.2f} {trees:>9.2f} | {own / gp:>9.2f}  {form}")


def main(arguments):
    if arguments[0] == "--peer":
        return peer(arguments[1], arguments[2])
    program, folder, rows, surfaces = arguments
    rsm = Rsm(os.path.abspath(program), folder)
    rsm.folder.mkdir(parents=True, exist_ok=True)
    digits_table(rsm)
    large_table(rsm, int(rows))
    selection_table(rsm, int(surfaces))
    maps_table(rsm)


main(sys.argv[1:])
