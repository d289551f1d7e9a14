"""Plans of patients beside the doses that came with them: figures of all `plan.json` in the folders below a folder.

    python stages/planning/plan/benches/beside_reference.py plans

Prints a row for each patient, with the figure of the reference in parentheses, then all figures by patient and mean, then the
limits of the protocol that both doses keep. Figures are of the segments where the plan has some, else of its fluence; those of
both doses are of the same structures on the same grid.
"""

import json
import pathlib
import sys

FIGURES = [
    ("PTV70", "d95_gy", 1, "D95 of PTV70"),
    ("PTV63", "d95_gy", 1, "D95 of PTV63"),
    ("PTV56", "d95_gy", 1, "D95 of PTV56"),
    ("PTV70", "d2_gy", -1, "D2 of PTV70"),
    ("PTV70", "conformity", 1, "Paddick of PTV70"),
    ("SpinalCord", "d0_03cc_gy", -1, "D0.03cc of the cord"),
    ("Brainstem", "d0_03cc_gy", -1, "D0.03cc of the brainstem"),
    ("LeftParotid", "mean_gy", -1, "mean of the left parotid"),
    ("RightParotid", "mean_gy", -1, "mean of the right parotid"),
    ("Esophagus", "mean_gy", -1, "mean of the esophagus"),
    ("Larynx", "mean_gy", -1, "mean of the larynx"),
    ("Mandible", "d0_03cc_gy", -1, "D0.03cc of the mandible"),
    ("Body", "mean_gy", -1, "mean of the body"),
    ("Body", "d0_03cc_gy", -1, "D0.03cc of the body"),
]
# Differences below this count as equal: 0.1 Gy, or 0.01 of an index.
EQUAL = {"conformity": 0.01}


def figures(structures):
    return {s["name"]: s for s in structures}


def delivered(plan):
    """The figures of what is exported."""
    return figures((plan["leaves"] or plan)["structures"])


plans = []
for path in sorted(pathlib.Path(sys.argv[1]).glob("*/plan.json")):
    with open(path, encoding="utf-8") as file:
        plans.append(json.load(file))
plans.sort(key=lambda plan: int("0" + "".join(filter(str.isdigit, plan["case"]["name"]))))

print("| patient | D95 of PTV70, Gy | cord, D0.03cc, Gy | parotids, mean, Gy | PTV70, Paddick | body, D0.03cc, Gy | monitor units | loss by leaves |")
print("| --- | --- | --- | --- | --- | --- | --- | --- |")
for plan in plans:
    own, other = delivered(plan), figures(plan["reference"])

    def pair(name, key, digits=1):
        if name not in own or own[name][key] is None or other.get(name, {}).get(key) is None:
            return "-"
        return f"{own[name][key]:.{digits}f} ({other[name][key]:.{digits}f})"

    glands = ", ".join(pair(name, "mean_gy") for name in ("LeftParotid", "RightParotid") if name in own)
    leaves = plan["leaves"] or {}
    units, loss = leaves.get("monitor_units"), leaves.get("loss")
    cells = [plan["case"]["name"], pair("PTV70", "d95_gy"), pair("SpinalCord", "d0_03cc_gy"), glands or "-"]
    cells += [pair("PTV70", "conformity", 2), pair("Body", "d0_03cc_gy"), "-" if units is None else f"{units:.0f}"]
    cells.append("-" if loss is None else f"{100 * loss:.1f} %")
    print("| " + " | ".join(cells) + " |")

print()
print("| figure | patients | plans, mean | references, mean | plan better | equal | reference better |")
print("| --- | --- | --- | --- | --- | --- | --- |")
for name, key, sign, title in FIGURES:
    pairs = []
    for plan in plans:
        own, other = delivered(plan).get(name), figures(plan["reference"]).get(name)
        if own and other and own[key] is not None and other[key] is not None:
            pairs.append((own[key], other[key]))
    if not pairs:
        continue
    gains = [sign * (own - other) for own, other in pairs]
    equal = EQUAL.get(key, 0.1)
    better, worse = sum(gain > equal for gain in gains), sum(gain < -equal for gain in gains)
    mean = [sum(values) / len(pairs) for values in zip(*pairs)]
    digits = 2 if key == "conformity" else 1
    row = [title, len(pairs), f"{mean[0]:.{digits}f}", f"{mean[1]:.{digits}f}", better, len(pairs) - better - worse, worse]
    print("| " + " | ".join(map(str, row)) + " |")



def value(structure, limit):
    """What a limit such as `D95%[%] >= 100` measures, where the figures hold it."""
    measure = limit.split("[")[0]
    key = {"D95%": "d95_gy", "D98%": "d98_gy", "D0.03cc": "d0_03cc_gy", "Mean": "mean_gy"}.get(measure)
    if structure is None or key is None:
        return None
    gray = structure[key]
    return 100 * gray / structure["prescribed_gy"] if "[%]" in limit else gray


def kept(structures, limits):
    count = {}
    for limit in limits:
        found = value(structures.get(limit["structure"]), limit["limit"])
        if found is not None:
            sign, bound = limit["limit"].split("] ")[1].split()
            holds = found >= float(bound) if sign == ">=" else found <= float(bound)
            count.setdefault((limit["structure"], limit["limit"]), []).append(holds)
    return count


totals = {}
for plan in plans:
    limits = plan["protocol"]["limits"]
    both = [kept(structures, limits) for structures in (delivered(plan), figures(plan["reference"]))]
    for key in both[0]:
        total = totals.setdefault(key, [0, 0, 0])
        total[0] += len(both[0][key])
        total[1] += sum(both[0][key])
        total[2] += sum(both[1].get(key, []))
print("\n| limit | patients | kept by plans | kept by references |")
print("| --- | --- | --- | --- |")
for (name, limit), (of, own, other) in sorted(totals.items()):
    print(f"| {name} {limit} | {of} | {own} | {other} |")
of, own, other = (sum(total[i] for total in totals.values()) for i in range(3))
print(f"| all | {of} | {own} | {other} |")
