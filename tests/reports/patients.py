"""Imports the patients of the public reports, and writes what becomes of each to docs/results/reports-patients.md.

    pip install pydicom numpy pynrrd
    STILLPOINT=target/debug/stillpoint python tests/reports/patients.py FOLDER

FOLDER holds the cases: `run_import.py`, `nrrd_cases.py` and `README.md`. Without it nothing is done. What a case is to
give stands in `EXPECTED` below: `read` with words that the import must print and values that the case must hold, or
`refused` with words that name the cause. The exit status is 1 if any case gives something else.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
PAGE = os.path.join(ROOT, "docs", "results", "reports-patients.md")

READ, REFUSED = "read", "refused"
BASE = {"PTV": 67.0}

# Case: (outcome, words of its output, volumes in cm3, roles, isocentre in mm).
EXPECTED = {
    "a00_base": (READ, [], BASE, {"PTV": "target", "Body": "external"}, [20, -10, 2.5]),
    "a01_tilt_iop": (REFUSED, ["oblique"]),
    "a02_tilt_shear": (REFUSED, ["corner"]),
    "a03_missing": (REFUSED, ["an image is missing"]),
    "a04_same_instance": (READ, ["copies of others"], BASE),
    "a05_two_acq": (REFUSED, ["remove one of them"]),
    "a06_unsorted": (READ, [], BASE, {}, [20, -10, 2.5]),
    "a07_mixed_spacing": (REFUSED, ["not evenly spaced"]),
    "a08_one_gap_2p6": (READ, ["taken as evenly spaced"], {"PTV": 65.45}),
    "a09_slope_per_slice": (READ, [], BASE),
    "a10_no_intercept": (REFUSED, ["RescaleIntercept is missing"]),
    "a11_minus2000_no_tag": (READ, [], BASE),
    "a12_padding_tag": (READ, [], BASE),
    "a14_bits12_signed": (READ, [], BASE),
    "a15_extended_hu": (READ, ["more than 3000 HU"], BASE),
    "a16_overflow": (READ, ["are clipped"], BASE),
    "b01_rle": (READ, [], BASE),
    "b02_j2k": (READ, [], BASE),
    "b03_jls": (REFUSED, ["JPEG 2000 lossless are read"]),
    "b04_deflated": (REFUSED, ["1.2.840.10008.1.2.1.99 is not read"]),
    "b05_implicit": (READ, [], BASE),
    "b06_bare": (READ, [], BASE),
    "b07_big": (REFUSED, ["1.2.840.10008.1.2.2 is not read"]),
    "b08_dicomdir": (READ, ["DICOMDIR"], BASE),
    "b09_mixed": (READ, ["MR, PT, REG, RTDOSE, RTPLAN, SR are left out"], BASE),
    "b10_sc_ct": (READ, ["is not a CT image"], BASE),
    "b11_one_coronal": (REFUSED, ["coronal"]),
    "b12_localizer": (READ, ["localizer"], BASE),
    "b13_two_series": (READ, ["which the RTSTRUCT names"], BASE),
    "b14_shared_series": (READ, [], BASE),
    "b15_thickness": (READ, [], BASE),
    "b16_aniso": (READ, [], {"PTV": 65.4}, {}, [20, -10, 2.5]),
    "b17_hfp": (READ, [], BASE, {}, [20, -10, 2.5]),
    "b18_ffs_rev": (READ, [], BASE, {}, [20, -10, 2.5]),
    "b19_hfdr": (REFUSED, ["HFDR, head first on the right side"]),
    "b20_no_position": (REFUSED, ["--position HFS"]),
    "b21_noise": (READ, [], BASE),
    "b22_text_numbers": (READ, [], BASE),
    "c01_no_contourseq": (READ, ["holds no voxel"], BASE),
    "c02_no_roicontour": (READ, ["holds no voxel"], BASE),
    "c03_empty_contour": (READ, ["1 contours have fewer than three points"], {"PTV": 67, "Rectum": 64}),
    "c04_two_points": (READ, ["2 contours have fewer than three points"], BASE),
    "c05_points": (READ, ["points or open lines"], BASE),
    "c06_ring": (READ, [], {"Ring": 188.5}),
    "c07_keyhole": (READ, [], {"Ring": 188.5}),
    "c08_islands": (READ, [], {"Lungs": 196.35}),
    "c09_offplane": (READ, [], BASE),
    "c10_zjitter": (READ, [], BASE),
    "c12_islands_z_jitter": (READ, [], {"Lungs": 196.35}),
    "c13_long_ds": (READ, [], BASE),
    "c14_scientific": (READ, [], BASE),
    "c15_trailing_backslash": (READ, [], BASE),
    "c16_comma": (REFUSED, ["finite numbers are expected"]),
    "c18_no_count": (READ, [], BASE),
    "c19_no_type": (REFUSED, ["ContourGeometricType is missing"]),
    "c20_no_observations": (READ, [], BASE, {"PTV": "target", "Body": "external"}),
    "c21_numbers": (READ, [], {"PTV": 67, "Rectum": 64}),
    "c22_same_number": (REFUSED, ["ROINumber", "PTV", "Rectum"]),
    "c23_orphan": (READ, ["which the structure set does not describe"], BASE),
    "c24_names": (READ, [], BASE),
    "c25_gb18030": (READ, [], BASE),
    "c26_no_charset": (READ, [], BASE),
    "c27_other_frame": (REFUSED, ["not the frame of reference of the images"]),
    "c29_no_frame": (READ, [], BASE),
    "c30_no_contourimage": (READ, [], BASE),
    "c31_no_colour": (READ, [], BASE),
    "c32_two_ss": (REFUSED, ["several RTSTRUCT"]),
    "c33_other_series": (REFUSED, ["names other series"]),
    "d01_minus_ptv": (
        READ, [], BASE,
        {"Rectum-PTV": "organ", "Lungs-PTV": "organ", "Body-PTV": "other", "PTV": "target"}, [20, -10, 2.5],
    ),
    "d02_ptv_ring": (
        READ, [], BASE, {"PTV_Ring_5cm": "organ", "PTV-old plan": "other", "PTV": "target"}, [20, -10, 2.5],
    ),
    "d03_helper_ptv": (READ, ["PTV_eval", "without a prescription"], BASE, {}, [20, -10, 2.5]),
    "d04_two_external": (READ, ["both outlines of the patient: the larger is taken"], BASE, {"Body": "external"}),
    "d05_skin_rind": (READ, [], BASE, {"Body": "external", "Skin": "organ"}),
    "d07_no_body": (READ, ["is made from the images"], {"PTV": 67, "Body": 4680}, {"Body": "external"}),
    "d08_gtv_only": (REFUSED, ["names table"]),
    "d09_target_names": (READ, [], {}, {"zPTV_High": "target", "PTVp": "target", "TargetVol 70": "target"}),
    "d10_prescribe_original": (READ, [], BASE),
    "d11_cgy": (REFUSED, ["must be a number with its unit, Gy"]),
    "d12_nounit": (REFUSED, ["must be a number with its unit, Gy"]),
    "d13_zero_fractions": (REFUSED, ["0 fractions"]),
    "d14_couch": (READ, ["does not count for the dose"], BASE, {"CouchSurface": "other"}),
    "d15_tiny": (READ, ["Cochlea", "left out"], BASE),
    "d16_srs": (READ, ["its contours hold 1.03 cm3, its voxels 1.50 cm3"]),
    "d17_every_second": (READ, ["contours are 10.0 mm apart"], {"PTV": 65.45}),
    "d18_finer": (READ, ["planes of contours are closer than the images"], {"PTV": 65.45}),
    "d19_beyond": (REFUSED, ["--allow-cut 6.03cm3"]),
    "d20_eight": (READ, [], BASE),
    "e01_offset_hu": (REFUSED, ["implausible Hounsfield units"]),
    "e02_override": (READ, ["has the density 1 by the structure set"], BASE),
    "e04_directdensity": (READ, ["Sd36f"], BASE),
    "e06_zero": (REFUSED, ["ends before its first element"]),
    "e07_long_contour": (READ, [], {"Fine": 251.33}),
    "e08_many_contours": (READ, [], BASE),
    "e09_mixed_sign": (READ, [], BASE),
    "e11_names_table": (
        READ, [], BASE,
        {"Parotid_Low": "organ", "CTV_7000": "target", "BowelBag-PTV": "organ", "SpinalCanal": "organ"},
    ),
    "e12_prostate_target": (READ, [], {"Prostate": 67}, {"Prostate": "target"}),
    "e14_out_of_body": (READ, ['"PTV" leaves the outline'], {"PTV": 65}),
    "e15_short_body": (READ, ['"PTV" leaves the outline "Body": 19.0'], BASE),
    "g01_closed_explicitly": (READ, [], BASE),
    "g02_float_count": (READ, [], BASE),
    "g03_blanks": (READ, ["another region has its name"], BASE),
    "g04_other_instances": (READ, [], BASE),
    "g05_two_patients": (REFUSED, ["PatientID"]),
    "g07_pad": (READ, [], BASE),
    "g08_dup_jitter": (READ, [], BASE),
    "n00": (READ, []),
    "n01_ras": (READ, []),
    "n02_las": (READ, []),
    "n03_flipz": (READ, []),
    "n04_spacings": (REFUSED, ["has no `space`"]),
    "n05_detached": (READ, []),
    "n06_big": (READ, []),
    "n07_gzip": (READ, []),
    "n08_bz2": (REFUSED, ["encoding: bzip2"]),
    "n09_float": (READ, []),
    "n10_u8": (READ, []),
    "n11_seg": (REFUSED, ["volumes have 3 axes"]),
    "n12_crlf": (READ, []),
    "n13_17": (REFUSED, ["write them as uint32"]),
    "n14_short": (REFUSED, ["end early"]),
    "n15_long": (REFUSED, ["a byte was added"]),
    "n17_cgy": (REFUSED, ["at most 200 Gy"]),
    "n18_rename": (READ, []),
    "n20_key": (READ, ['"prescription_gy"', "is not read"]),
}


def run(arguments, **kwargs):
    return subprocess.run(arguments, capture_output=True, text=True, **kwargs)


def differences(name, code, text, show):
    """What a case gives other than it is to give."""
    if name not in EXPECTED:
        return ["no expectation is written for it"]
    outcome, words, volumes, roles, isocentre = (*EXPECTED[name], *({}, {}, None)[len(EXPECTED[name]) - 2:])
    found = []
    if (code == 0) != (outcome == READ):
        found.append(f"{READ if code == 0 else REFUSED} in place of {outcome}")
    found += [f"does not print {word!r}" for word in words if word not in text]
    if code != 0 or show is None:
        return found
    structures = {s["name"]: s for s in show["structures"]}
    for structure, due in volumes.items():
        volume = structures.get(structure, {}).get("volume_cm3")
        if volume is None or abs(volume - due) > 0.1 * due:
            found.append(f"{structure} has {volume} cm3 in place of {due}")
    for structure, due in roles.items():
        role = structures.get(structure, {}).get("role")
        if role != due:
            found.append(f"{structure} is {role} in place of {due}")
    if isocentre and any(abs(a - b) > 1 for a, b in zip(show["isocentre_mm"], isocentre)):
        found.append(f"isocentre {show['isocentre_mm']} in place of {isocentre}")
    return found


def main():
    folder = sys.argv[1] if len(sys.argv) > 1 else ""
    if not os.path.exists(os.path.join(folder, "run_import.py")):
        print("the folder of the cases is missing: nothing is done")
        return 0
    stillpoint = os.path.abspath(os.environ.get("STILLPOINT", os.path.join(ROOT, "target/debug/stillpoint")))
    with tempfile.TemporaryDirectory() as scratch:
        work = os.path.join(scratch, "work")
        for name in os.listdir(folder):
            if name.endswith(".py"):
                shutil.copy(os.path.join(folder, name), scratch)
        environment = {**os.environ, "STILLPOINT": stillpoint, "WORK": work}
        made = [run([sys.executable, script], cwd=scratch, env=environment)
                for script in ("run_import.py", "nrrd_cases.py")]
        with open(os.path.join(work, "results.json")) as file:
            results = json.load(file)
        cases = [(name, r["source"], r["rc"], r["out"] + r["err"]) for name, r in results.items()]
        for block in re.split(r"^== ", made[1].stdout, flags=re.M)[1:]:
            head, text = block.split("\n", 1)
            name, source = [part.strip() for part in head.split("|")[:2]]
            cases.append((name, source, int(re.search(r"rc (\d+)", text).group(1)), text))
        rows, wrong = [], 0
        for name, source, code, text in sorted(cases):
            case = os.path.join(work, "out", name + ".case")
            show = None
            if code == 0:
                show = json.loads(run([stillpoint, "case", "show", case, "--json"]).stdout)
            found = differences(name, code, text, show)
            wrong += bool(found)
            outcome, words = EXPECTED.get(name, ("?", []))[:2]
            due = outcome + (": " + ", ".join(f"`{w}`" for w in words) if words else "")
            rows.append(f"| {name} | {source.replace('|', '/')} | {due} | {'as expected' if not found else '; '.join(found)} |")
            if found:
                print(name, "; ".join(found))
    missing = sorted(set(EXPECTED) - {c[0] for c in cases})
    for name in missing:
        print(name, "was not run")
    with open(PAGE, "w") as file:
        file.write(
            "# Imports that public reports describe\n\n"
            "Synthetic patients, each with a fault or a peculiarity of files that public reports or clinics show. Written by\n"
            "`python tests/reports/patients.py FOLDER`, which compares each import with what is expected: outcome, words of\n"
            "the output, volumes within 10 %, roles, and the isocentre within 1 mm.\n\n"
            f"{len(rows)} cases, {len(rows) - wrong} as expected.\n\n"
            "| case | peculiarity | expected | found |\n| --- | --- | --- | --- |\n" + "\n".join(rows) + "\n"
        )
    print(f"{len(rows)} cases, {wrong} differ")
    return 1 if wrong or missing else 0


if __name__ == "__main__":
    sys.exit(main())
