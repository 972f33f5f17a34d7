"""Errors of closed forms and of whole estimates in stiff and extreme cases: tables and plots into out/stability.

python -m tests.stability.run [--shapes N]

Exit status 1 if a number isn't finite, has the wrong sign where the precision is said to be enough, or an estimate is
further off than allowed, or a picture of an extreme scene is wrong, takes too long or too much memory.
"""

import argparse
import sys

from tests.bench.engines import ROOT
from tests.stability import report
from tests.stability.cases import FAMILIES
from tests.stability.measure import measure
from tests.stability.pictures import CASES, plot, run_case, table
from tests.stability.scenes import SCENE_FAMILIES, is_as_allowed, measure_scenes


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
    scene_rows = measure_scenes(SCENE_FAMILIES)
    report.write_csv(folder / "scenes.csv", scene_rows)
    report.write_scene_markdown(folder / "scenes.md", SCENE_FAMILIES, scene_rows)
    report.plot_scenes(folder / "scenes.png", SCENE_FAMILIES, scene_rows)
    scenes_by_name = {family.name: family for family in SCENE_FAMILIES}
    exceeded = [row for row in scene_rows if not is_as_allowed(scenes_by_name[row.family], row)]
    for row in exceeded:
        print(f"{row.family}, {row.parameter:g}: errors {row.errors} exceed what is allowed", file=sys.stderr)
    picture_rows = []
    for case in CASES:
        picture_rows.append(run_case(case))
        (folder / "pictures.md").write_text(table(picture_rows), encoding="utf-8")
    plot(folder / "pictures.png", picture_rows)
    wrong = [row for row in picture_rows if row.verdict]
    for picture in wrong:
        print(f"picture of {picture.name}: {picture.verdict}", file=sys.stderr)
    print(f"{len(rows) + len(scene_rows) + len(picture_rows)} rows; tables and plots in {folder.relative_to(ROOT)}")
    return 1 if bad or exceeded or wrong else 0


if __name__ == "__main__":
    sys.exit(main())
