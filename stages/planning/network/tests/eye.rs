//! The features turn, mirror and move with the patient.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use stillpoint_network::Eye;
use stillpoint_network::eye::EyeError;
use stillpoint_patient::Grid;
use stillpoint_patient::case::{Case, CaseParts, Mask, PatientPosition, Prescription, Role, Structure};
use stillpoint_plan::dose::Machine;
use stillpoint_plan::fluence::{Objective, ObjectiveSpec, Overdose, StructureObjectives};

const COUNT: usize = 43;
/// No multiple of the steps of rays and points, so that none of these lies on the border of two voxels.
const SPACING_MM: f64 = 4.7;
const ANGLES: usize = 24;

/// A patient without any symmetry of his own; `place` says where a voxel of him comes from.
fn patient(origin_mm: [f64; 3], place: impl Fn([f64; 3]) -> [f64; 3]) -> Case {
    let middle = 0.5 * (COUNT as f64 - 1.0) * SPACING_MM;
    let grid = Grid { counts: [COUNT, COUNT, 23], spacing_mm: [SPACING_MM; 3], origin_mm };
    let at = |i: usize| {
        let centre = grid.centre_mm(grid.voxel(i));
        place([
            centre[0] - origin_mm[0] - middle,
            centre[1] - origin_mm[1] - middle,
            centre[2] - origin_mm[2] - 51.7,
        ])
    };
    let ball = |middle: [f64; 3], radii: [f64; 3]| {
        Mask::from_fn(grid.len(), |i| {
            let p = at(i);
            (0..3).map(|k| ((p[k] - middle[k]) / radii[k]).powi(2)).sum::<f64>() <= 1.0
        })
    };
    let body = ball([3.0, 0.0, 0.0], [92.0, 71.0, 400.0]);
    let organ = ball([22.0, 28.0, 4.0], [17.0, 14.0, 22.0]);
    let bone = ball([-48.0, 11.0, -6.0], [19.0, 18.0, 26.0]);
    let target = ball([0.0, 0.0, 0.0], [23.0, 18.0, 21.0]);
    let hu = (0..grid.len()).map(|i| {
        if bone.contains(i) {
            900
        } else if body.contains(i) {
            20
        } else {
            -1000
        }
    });
    let structure = |name: &str, role, mask| Structure { name: name.to_owned(), role, mask };
    Case::new(CaseParts {
        name: "patient".into(),
        grid,
        hu: hu.collect(),
        structures: vec![
            structure("Body", Role::External, body.clone()),
            structure("PTV", Role::Target, target),
            structure("Organ", Role::Organ, organ),
            structure("Bone", Role::Organ, bone.clone()),
        ],
        isocentre_mm: Some([origin_mm[0] + middle, origin_mm[1] + middle, origin_mm[2] + 51.7]),
        prescription: vec![Prescription { structure: "PTV".into(), dose_gy: 60.0 }],
        fractions: Some(30),
        reference_dose_gy: None,
        uids: None,
        provenance: String::new(),
    })
    .unwrap()
}

fn requested() -> Vec<StructureObjectives> {
    let over = |name: &str, dose, weight| StructureObjectives {
        name: name.into(),
        voxels: Vec::new(),
        volumes: Vec::new(),
        to_target_mm: Vec::new(),
        objectives: vec![Objective::Overdose(Overdose { dose, weight })],
    };
    vec![
        over("PTV", 60.0, 100.0),
        over("Organ", 30.0, 20.0),
        over("Bone", 20.0, 8.0),
        over("Body", 20.0, 8.0),
    ]
}

fn eye(case: &Case) -> Eye {
    Eye::of_case(case, &requested(), &Machine::shipped().unwrap(), ANGLES, 10.0).unwrap()
}

/// Whether angle `a` of one patient sees what angle `to(a)` of the other sees.
#[track_caller]
fn same(one: &Eye, other: &Eye, to: impl Fn(usize) -> usize) {
    let near = |a: &[f32], b: &[f32], what: String| {
        let off = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off < 2e-4, "{what}: {a:?} {b:?}");
    };
    for a in 0..ANGLES {
        near(&one.target[a], &other.target[to(a)], format!("target at {a}"));
        for (place, (s, t)) in one.structures.iter().zip(&other.structures).enumerate() {
            near(&s[a], &t[to(a)], format!("structure {place} at {a}"));
        }
        for b in 0..ANGLES {
            let (p, q) = (&one.pairs[a * ANGLES + b], &other.pairs[to(a) * ANGLES + to(b)]);
            near(p, q, format!("pair {a} {b}"));
        }
    }
    // The claim is empty where nothing differs from angle to angle.
    assert!((0..ANGLES).any(|a| (one.target[a][0] - one.target[0][0]).abs() > 0.05));
}

#[test]
fn a_mirrored_patient_has_mirrored_features() {
    let (one, other) = (patient([0.0; 3], |p| p), patient([0.0; 3], |[x, y, z]| [-x, y, z]));
    same(&eye(&one), &eye(&other), |a| (ANGLES - a) % ANGLES);
}

#[test]
fn the_features_turn_with_the_patient() {
    // Turned about the couch's long axis by 90 degrees: what was in front (-y) is on the left (+x).
    let (one, other) = (patient([0.0; 3], |p| p), patient([0.0; 3], |[x, y, z]| [y, -x, z]));
    same(&eye(&one), &eye(&other), |a| (a + ANGLES / 4) % ANGLES);
}

#[test]
fn the_features_do_not_depend_on_where_the_image_lies() {
    let (one, other) = (patient([0.0; 3], |p| p), patient([-310.0, 42.0, 1000.0], |p| p));
    same(&eye(&one), &eye(&other), |a| a);
}

#[test]
fn a_prone_patient_is_seen_from_the_other_side() {
    let one = patient([0.0; 3], |p| p);
    let prone = one.clone().lying(PatientPosition::HeadFirstProne);
    same(&eye(&one), &eye(&prone), |a| (a + ANGLES / 2) % ANGLES);
}

#[test]
fn an_organ_in_the_way_is_before_and_one_beyond_is_behind() {
    // The bone lies on the right: before the target from 270 degrees, behind from 90.
    let seen = eye(&patient([0.0; 3], |p| p));
    let (left, right) = (ANGLES / 4, 3 * ANGLES / 4);
    let bone = &seen.structures[1];
    assert!(bone[right][4] > 0.3 && bone[right][6] < 0.05, "{:?}", bone[right]);
    assert!(bone[left][6] > 0.3 && bone[left][4] < 0.05, "{:?}", bone[left]);
    assert!(bone[right][0] > bone[left][0], "the beam is weaker behind the target");
    assert!(seen.target[right][9] > seen.target[left][9], "bone before the target");
}

#[test]
fn cases_that_cannot_be_seen_are_refused() {
    let case = patient([0.0; 3], |p| p);
    let machine = Machine::shipped().unwrap();
    assert_eq!(Eye::of_case(&case, &[], &machine, ANGLES, 10.0), Err(EyeError::NoRisk));
    assert_eq!(Eye::of_case(&case, &requested(), &machine, 4, 10.0), Err(EyeError::Angles(4)));
}

/// What an organ tolerates is what its objective says, whatever its shape.
#[test]
fn every_objective_that_limits_the_dose_of_an_organ_is_seen() {
    let (case, machine) = (patient([0.0; 3], |p| p), Machine::shipped().unwrap());
    let seen = |text: &str| {
        let spec: ObjectiveSpec = serde_json::from_str(text).unwrap();
        let mut structures = requested();
        structures[1].objectives = vec![spec.resolve(60.0, 60.0)];
        Eye::of_case(&case, &structures, &machine, ANGLES, 10.0).unwrap()
    };
    let overdose = seen(r#"{"overdose": {"dose": "24 Gy", "weight": 20}}"#);
    for text in [
        r#"{"geud": {"a": 8, "limit": "<= 40 %", "weight": 20}}"#,
        r#"{"dvh_point": {"limit": "V24Gy <= 30 %", "weight": 20}}"#,
        r#"{"dvh_point": {"limit": "D5% <= 24 Gy", "weight": 20}}"#,
        r#"{"mean_dose": {"dose": "24 Gy", "weight": 20}}"#,
    ] {
        assert_eq!(seen(text), overdose, "{text}");
    }
    let risks = overdose.structures.len();
    for text in [
        r#"{"geud": {"a": -10, "limit": ">= 24 Gy", "weight": 20}}"#,
        r#"{"mean_at_least": {"dose": "24 Gy", "weight": 20}}"#,
        r#"{"dvh_point": {"limit": "D95% >= 24 Gy", "weight": 20}}"#,
    ] {
        assert_eq!(seen(text).structures.len(), risks - 1, "{text}");
    }
}
