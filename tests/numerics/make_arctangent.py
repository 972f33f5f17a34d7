"""Minimax polynomials of the arctangent in server/derivatives/simd.h, by Remez's exchange algorithm.

    python -m tests.numerics.make_arctangent

prints coefficients c with atan(t) ~ t + t z (c_0 + c_1 z + ...), z = t^2, 0 <= t <= tan(pi/8), and the largest relative
error in exact arithmetic.
"""

from mpmath import mp, mpf

mp.dps = 60
LARGEST = mp.tan(mp.pi / 8) ** 2


def target(z: mpf) -> mpf:
    t = mp.sqrt(z)
    return (mp.atan(t) / t - 1) / z


def weight(z: mpf) -> mpf:
    """Turns the polynomial's error into the relative error of the arctangent."""
    t = mp.sqrt(z)
    return z * t / mp.atan(t)


def minimax(degree: int) -> tuple[list[mpf], mpf]:
    count = degree + 2
    nodes = [LARGEST * (1 - mp.cos(mp.pi * (i + mpf(1) / 2) / count)) / 2 for i in range(count)]
    grid = [LARGEST * (1 - mp.cos(mp.pi * i / 400)) / 2 for i in range(1, 401)]
    coefficients: list[mpf] = []
    errors: list[mpf] = []
    for _ in range(20):
        # The polynomial whose weighted error has the same size and alternating sign at all nodes.
        system = mp.matrix(count, count)
        right = mp.matrix(count, 1)
        for i, node in enumerate(nodes):
            for power in range(degree + 1):
                system[i, power] = node**power
            system[i, degree + 1] = (-1) ** i / weight(node)
            right[i] = target(node)
        solution = mp.lu_solve(system, right)
        coefficients = [solution[power] for power in range(degree + 1)]
        errors = [weight(z) * (mp.polyval(coefficients[::-1], z) - target(z)) for z in grid]
        # New nodes: the extremum of each run of one sign.
        runs: list[list[int]] = [[0]]
        for i in range(1, len(grid)):
            if (errors[i] > 0) == (errors[runs[-1][-1]] > 0):
                runs[-1].append(i)
            else:
                runs.append([i])
        if len(runs) != count:
            break
        nodes = [grid[max(run, key=lambda i: abs(errors[i]))] for run in runs]
    return coefficients, max(abs(error) for error in errors)


def main() -> None:
    for name, degree, digits in (("float", 3, 12), ("double", 9, 20)):
        coefficients, error = minimax(degree)
        print(f"{name}: {', '.join(mp.nstr(c, digits) for c in coefficients)}; error {mp.nstr(error, 2)}")


if __name__ == "__main__":
    main()
