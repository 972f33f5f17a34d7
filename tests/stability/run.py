"""Errors of the closed forms in stiff and extreme configurations: tables and plots into out/stability.

python -m tests.stability.run [--shapes N]

Exit status 1 if a number isn't finite, or has the wrong sign where the precision is said to be enough.
"""

import argparse
import sys

from tests.bench.engines import ROOT
from tests.stability import report
from tests.stability.cases import FAMILIES
from tests.stability.measure import measure


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shapes", type=int, default=4, help="random shapes of each family (at most 4)")
    rows = measure(FAMILIES, parser.parse_args().shapes)
    folder = ROOT / "out" / "stability"
    folder.mkdir(parents=True, exist_ok=True)
    report.write_csv(folder / "closed_forms.csv", rows)
    report.write_markdown(folder / "closed_forms.md", FAMILIES, rows)
    report.plot(folder / "closed_forms.png", FAMILIES, rows)
    by_name = {family.name: family for family in FAMILIES}
    bad = [row for row in rows if report.verdict(by_name[row.family], row) in ("NOT FINITE", "WRONG SIGN")]
    for row in bad:
        verdict = report.verdict(by_name[row.family], row)
        print(f"{row.family}, {row.parameter:g}, {row.precision}: {verdict}", file=sys.stderr)
    print(f"{len(rows)} rows; tables and plots in {folder.relative_to(ROOT)}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
