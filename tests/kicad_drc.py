"""Run KiCad's design rules over boards, with the Python that has `pcbnew`: print a JSON line of counts for each.

It stands alone, since KiCad's Python has no other package.
"""

import json
import re
import sys
import tempfile


def main(paths):
    import pcbnew

    for path in paths:
        board = pcbnew.LoadBoard(path)
        with tempfile.NamedTemporaryFile("r", suffix=".rpt") as report:
            pcbnew.WriteDRCReport(board, report.name, pcbnew.EDA_UNITS_MILLIMETRES, True)
            text = report.read()
        counts = [int(count) for count in re.findall(r"\*\* Found (\d+) ", text)]
        kinds = sorted(set(re.findall(r"^\[(\w+)\]", text, re.M)))
        clearance = board.GetDesignSettings().m_MinClearance
        print(json.dumps({"path": path, "counts": counts, "kinds": kinds, "clearance_nm": clearance}))


if __name__ == "__main__":
    main(sys.argv[1:])
