use stillpoint_plan::measured::{Across, Kind, read};

use crate::{only, refused};

const DEPTH_DOSE: &str = include_str!("../../data/measured/depth_dose.mcc");
pub const PROFILES: &str = include_str!("../../data/measured/profiles.mcc");

#[test]
fn scans_of_a_water_tank_are_read_with_their_settings() {
    let curve = only("depth_dose.mcc", DEPTH_DOSE);
    assert_eq!((curve.kind, curve.points.len()), (Kind::DepthDose, 85));
    assert_eq!((curve.points[1].value, curve.points[2].value), (0.91658, 1.1706));
    assert_eq!((curve.setup.field_mm, curve.setup.ssd_mm), ([100.0, 100.0], 1000.0));
    let measured = read("profiles.mcc", PROFILES.as_bytes()).unwrap();
    let kinds: Vec<Kind> = measured.curves.iter().map(|curve| curve.kind).collect();
    let profile = |across| Kind::Profile { across, depth_mm: 100.0 };
    assert_eq!(kinds, [profile(Across::Y), profile(Across::X)]);
    assert_eq!(measured.energy_mv.unwrap().0, 6.0);
}

#[test]
fn other_beams_and_cut_files_are_refused() {
    let refused_with = |from: &str, to: &str, pieces: &[&str]| refused(&DEPTH_DOSE.replace(from, to), pieces);
    refused_with("MODALITY=X", "MODALITY=EL", &["MODALITY is EL", "photons"]);
    refused_with("MEAS_MEDIUM=WATER", "MEAS_MEDIUM=AIR", &["MEAS_MEDIUM is AIR"]);
    refused_with("WEDGE_ANGLE=0.00", "WEDGE_ANGLE=30.00", &["WEDGE_ANGLE is 30", "open fields"]);
    refused_with("SCAN_OFFAXIS_INPLANE=0.00", "SCAN_OFFAXIS_INPLANE=40.00", &["SCAN_OFFAXIS_INPLANE is 40"]);
    refused_with("SCAN_CURVETYPE=PDD", "SCAN_CURVETYPE=TPR", &["SCAN_CURVETYPE is TPR"]);
    refused_with("\t\tSSD=1000.00\n", "", &["has no `SSD`"]);
    refused_with("SSD=1000.00", "SSD=1000,00", &["decimal point"]);
    refused_with("ENERGY=6.00", "ENERGY=600", &["the energy is 600"]);
    refused_with("\t\tEND_DATA\n", "", &["the place is `END_SCAN`"]);
    refused_with("\tEND_SCAN  1\n", "", &["is not allowed here"]);
    refused_with("1.6499E+00", "1.6499E+400", &["the value is `1.6499E+400`"]);
    let cut = &DEPTH_DOSE[..DEPTH_DOSE.find("END_DATA").unwrap()];
    refused(cut, &["has no `END_DATA`"]);
    refused(&PROFILES.replace("COLL_ANGLE=0.00", "COLL_ANGLE=30.00"), &["COLL_ANGLE is 30"]);
}
