use stillpoint_plan::measured::{Across, Kind, read};

use crate::{depth_dose, profile, refused};

fn depth_dose_block() -> String {
    let mut text = "$STOM\n# Detector: chamber\n%VERSION 02\n%DATE 01-02-2020\n%DETY CHA\n%BMTY PHO\n%FLSZ 100*100\n%TYPE OPD\n\
                    %AXIS Z\n%PNTS 61\n%STEP 050\n%SSD  900\n"
        .to_owned();
    for (depth, dose) in depth_dose(5.0) {
        text += &format!("<+000.0 +000.0 +{depth:05.1} +{dose:05.1}>\n");
    }
    text + "$ENOM\n"
}

fn profile_block() -> String {
    let mut text =
        "$ STOM\n% VERSION 02\n% BMTY PHO\n% FLSZ 100 * 100\n% TYPE OPP\n% AXIS Y\n% PNTS 81\n% SSD 900\n% DPTH 100\n".to_owned();
    for (y, dose) in profile() {
        text += &format!("< {:+12.4} {y:+12.4} {:+12.4} {dose:+12.4} >\n", 0.0, 100.0);
    }
    text + "$ ENOM\n"
}

#[test]
fn depth_doses_and_profiles_are_read_in_both_usual_spellings() {
    let text = whole();
    let measured = read("x06.asc", text.as_bytes()).unwrap();
    assert_eq!(measured.curves[0].kind, Kind::DepthDose);
    assert_eq!(measured.curves[1].kind, Kind::Profile { across: Across::Y, depth_mm: 100.0 });
    assert_eq!(measured.curves.iter().map(|curve| curve.points.len()).collect::<Vec<_>>(), [61, 81]);
    assert_eq!(measured.curves[1].setup.field_mm, [100.0, 100.0]);
}

#[test]
fn what_contradicts_itself_or_is_not_an_open_photon_field_is_refused() {
    let block = depth_dose_block();
    refused(&format!("$NUMS 003\n{block}"), &["the number of curves is 1", "3"]);
    refused(&block.replace("PNTS 61", "PNTS 62"), &["the number of points is 61", "says 62"]);
    refused(&block.replace("BMTY PHO", "BMTY ELE"), &["BMTY is ELE", "photons"]);
    refused(&block.replace("TYPE OPD", "TYPE DPR"), &["DPR along Z"]);
    refused(&block.replace("%AXIS Z", "%WDGL 15\n%AXIS Z"), &["the wedge is 15"]);
    refused(&block.replace("%FLSZ 100*100\n", ""), &["has no `%FLSZ`"]);
    refused(&block.replace("%FLSZ 100*100", "%FLSZ 100"), &["FLSZ is `100`"]);
    refused(&block.replace("$ENOM", ""), &["has no `$ENOM`"]);
    refused(&format!("{block}%SSD 900\n"), &["`%SSD 900` is not allowed here"]);
    refused(
        &block.replace("<+000.0 +000.0 +050.0", "<+000.0 +030.0 +050.0"),
        &["line 23", "y of a point, mm, is 30"],
    );
    refused(&block.replace("+050.0", "+05,0"), &["decimal point"]);
    refused(&profile_block().replace("DPTH 100", "DPTH 50"), &["the depth of a point, mm, is 100", "50"]);
}

/// A file with both kinds of curves.
pub fn whole() -> String {
    format!("$NUMS 002\n{}{}$ENOF\n", depth_dose_block(), profile_block())
}
