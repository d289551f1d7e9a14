"""Runs the recordings that were rebuilt from public reports, and writes a table of verdicts.

    STILLPOINT=target/debug/stillpoint STILLPOINT_DATA=... python3 tests/reports/recordings.py [--md FILE] [CASE ...]

STILLPOINT_DATA is the folder with `reports/recordings`. Needs the Python packages `mcap`, `numpy`, `lz4` and `zstandard`.
A case passes with the clouds that are expected, with a refusal that holds the expected words, or in one of the ways of
ALSO_RIGHT. Exit 1 if one does not pass.
"""
import argparse
import contextlib
import io
import os
import sys
import tempfile

# Cases whose right outcome is another than their file says, with the words that the output must hold, and why.
ALSO_RIGHT = {
    "A03-row-step-zero-organised": (0, "", "the input of A03c with fewer rows: the data are exactly the points, so row_step 0 is unset"),
    "B03-mono16": (2, "depth_unit", "mono16 may be brightness: the refusal names the parameter that states depth"),
    "C35c-anchors": (2, "anchors", "the refusal names the form of YAML that is not read"),
    "C39-one-bad-in-three": (0, "1 of 3 messages left out", "the damaged message is left out, counted and named; `strict: true` refuses"),
    "E15-cr-only": (2, "CR alone", "the refusal names the line ends and the cure"),
    "I05b-same-time-twice-repeat": (0, "", "one message in a loop is one a tick"),
}


def outcome(module, case, work):
    """Verdict, exit code and the lines that the program printed."""
    told = io.StringIO()
    with contextlib.redirect_stdout(told):
        verdict = module.run(case)
    said = open(os.path.join(work, case, "said.txt"), encoding="utf-8", errors="replace").read()
    code = said.split("\nrc ", 1)[1].split(" ", 1)[0]
    output = said.split("\n", 2)[2]
    reason = next((line for line in output.splitlines() if "operator src:" in line or "error" in line), "")
    if verdict != "ok" and case in ALSO_RIGHT:
        due, words, why = ALSO_RIGHT[case]
        if code == str(due) and words in output:
            return "ok", code, why
    first = told.getvalue().splitlines()[0] if told.getvalue() else ""
    return verdict, code, reason.strip() or (first.split("clouds=")[-1] if verdict != "ok" else "")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*")
    parser.add_argument("--md", help="write the table to this file")
    args = parser.parse_args()
    folder = os.path.join(os.environ.get("STILLPOINT_DATA", ""), "reports", "recordings")
    if not os.path.isdir(folder):
        print(f"skipped: no folder {folder or 'reports/recordings'}: set STILLPOINT_DATA")
        return 0
    os.environ["STILLPOINT"] = os.path.abspath(os.environ.get("STILLPOINT", "target/debug/stillpoint"))
    with tempfile.TemporaryDirectory() as work:
        os.environ["WORK"] = work
        sys.path.insert(0, folder)
        import run as module

        names = sorted(os.listdir(os.path.join(folder, "in")))
        names = [n for n in names if not args.cases or any(n.startswith(c) for c in args.cases)]
        rows, passed = [], 0
        for case in names:
            verdict, code, remark = outcome(module, case, work)
            passed += verdict == "ok"
            remark = remark.replace(work, "").replace("|", "\\|")[:160]
            rows.append(f"| {case} | {verdict} | {code} | {remark} |")
            print(rows[-1], flush=True)
    print(f"{passed} of {len(names)} pass")
    if args.md:
        with open(args.md, "w", encoding="utf-8") as out:
            out.write("# Recordings of public reports\n\n")
            out.write("Made by `tests/reports/recordings.py --md docs/results/reports-recordings.md`. A case passes with the ")
            out.write("expected clouds, or with a refusal that names the cause.\n\n")
            out.write(f"{passed} of {len(names)} cases pass.\n\n| case | verdict | exit | remark |\n| --- | --- | --- | --- |\n")
            out.write("\n".join(rows) + "\n")
    return 0 if passed == len(names) else 1


if __name__ == "__main__":
    sys.exit(main())
