"""The paper, figure by figure: Tables 2 and 3, Figs. 6, 7, 9, 10, 11 and 13 to 15, each beside what the paper says.

Reference: what Wang, Liu and Hong (2018) print. Where they compare the partition method with FE, also the full FE model
of the same mesh. There are three parts. `impact` is rod on plate at the paper's settings (40 kHz, 0.596 m/s, 5 ms).
`schemes` is the four truncations of Fig. 11 in the paper's basis and ours, on a coarser mesh. `mechanism` is the crank
slider. Lengths, thickness and material constants are reconstructed, because Tables 1 and 4 are missing in our copy.
Quantity and limits: in each part. A row says whether it agrees with the paper's statement. Disagreements that are
understood say why, and are no failure. Any other disagreement is one.

    python -m validation.paper.paper [--quick] [--only PART ...] [--out FILE]

`--only` measures some parts and keeps the other parts of the file. Each part is written as soon as it is done.
"""

import argparse
import json
import os
import platform
import sys
import time
from pathlib import Path

import matplotlib as mpl
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep

mpl.use("Agg")
from validation.paper import cost, impact, mechanism, schemes
from validation.paper.statements import HEAD, cells, failures

PARTS = {"impact": impact.run, "schemes": schemes.run, "mechanism": mechanism.run}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="coarser mesh, shorter, no scheme 4 and no Table 3")
    parser.add_argument("--only", nargs="+", choices=PARTS, help="parts to measure", default=list(PARTS))
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".json"), help="file of the results")
    options = parser.parse_args()
    (impact.ROOT / "out").mkdir(exist_ok=True)
    kept = json.loads(options.out.read_text()) if options.out.exists() else {}
    parts = kept.get("parts", {})
    for name in options.only:
        begin = time.perf_counter()
        parts[name] = PARTS[name](options.quick) | {"quick": options.quick}
        parts[name]["time_s"] = time.perf_counter() - begin
        options.out.write_text(json.dumps({**kept, "parts": parts}, indent=1) + "\n")
        print(f"{name}: {parts[name]['time_s']:.0f} s", flush=True)
    missing = [name for name in PARTS if name not in parts]
    if missing:
        parser.error(f"{options.out} holds nothing of {', '.join(missing)} yet: measure them too")
    table_3 = {"rows": [], "tables": {}} if options.quick else cost.table_3(parts["impact"], parts["schemes"])
    rows = [row for part in (*parts.values(), table_3) for row in part["rows"]]
    lines = [cells(row) for row in rows]
    tables = {
        "The paper beside this library; lengths and materials are reconstructed": (HEAD, lines),
        **parts["schemes"]["tables"],
        **table_3["tables"],
    }
    for title, (head, content) in tables.items():
        table = Table(*head, title=title)
        for line in content:
            table.add_row(*map(str, line))
        Console(width=180).print(table)
    data = {
        "rows": rows,
        "tables": tables,
        "parts": parts,
        "machine": {"cpus": os.cpu_count(), "platform": platform.platform(), "versions": ep.versions()},
    }
    options.out.write_text(json.dumps(data, indent=1) + "\n")
    failed = failures(rows)
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
