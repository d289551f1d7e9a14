use stillpoint_plan::measured::{Kind, Measured, read};

use crate::{depth_dose, depth_dose_table, fault, only, profile, refused};

#[test]
fn curves_and_readings_are_read_in_any_order_of_columns_and_directions() {
    let curve = only("a.csv", &depth_dose_table(5.0));
    assert_eq!((curve.kind, curve.points.len(), curve.line), (Kind::DepthDose, 61, 2));
    assert_eq!(curve.points[3].at_mm, 15.0);

    let mut text = "# scans\nvalue;kind;ssd_mm;field_y_mm;field_x_mm;off_mm;depth_mm;energy_mv\n".to_owned();
    for (depth, dose) in depth_dose(5.0).into_iter().rev() {
        text += &format!("{dose};depth_dose;1000;50;100;0;{depth};6\n");
    }
    for (x, dose) in profile() {
        text += &format!("{dose};profile_y;900;100;100;{x};100;6\n");
    }
    text += "0.95;output;900;50;50;0;100;6\n0.0083;calibration;900;100;100;0;100;6\n";
    let measured = read("b.csv", text.as_bytes()).unwrap();
    assert_eq!(measured.curves.len(), 2);
    assert_eq!(measured.curves[0].setup.field_mm, [100.0, 50.0]);
    assert_eq!(measured.curves[0].points[0].at_mm, 0.0);
    assert_eq!((measured.outputs[0].value, measured.calibrations[0].value), (0.95, 0.0083));
    assert_eq!(measured.energy_mv, Some((6.0, "b.csv".to_owned())));
}

#[test]
fn strange_numbers_are_refused_with_their_line() {
    let table = depth_dose_table(5.0);
    let with = |line: usize, text: &str| {
        let mut lines: Vec<&str> = table.lines().collect();
        lines[line - 1] = text;
        lines.join("\n")
    };
    refused(&with(7, "depth_dose,100,100,900,25,0,NaN"), &["scan.txt, line 7", "value is `NaN`"]);
    refused(&with(7, "depth_dose,100,100,900,25,0,inf"), &["line 7", "not a finite number"]);
    refused(&with(7, "depth_dose,100,100,900,25,0,87,5"), &["line 7", "8 fields", "decimal comma"]);
    refused(&with(7, "depth_dose,100,100,900,25,0,-3"), &["line 7", "the dose is -3"]);
    refused(&with(7, "depth_dose,100,100,900,20,0,88"), &["line 7", "two values at 20 mm"]);
    refused(&with(7, "depth_dose,100,100,900,250,0,88"), &["line 8", "30 mm comes after 250 mm"]);
    refused(&with(7, "depth_dose,100,100,900,25,3,88"), &["line 7", "off_mm is 3"]);
    refused(&with(7, "depth_doses,100,100,900,25,0,88"), &["line 7", "`depth_doses`", "profile_x"]);
    refused(&with(7, "depth_dose,100,100,90,25,0,88"), &["line 8", "began before at line 2"]);
    refused(
        &with(1, "kind,field_x_cm,field_y_cm,ssd_cm,depth_cm,off_cm,value"),
        &["`field_x_cm` is not known"],
    );
    refused(&with(1, "kind,field_x_mm,field_x_mm,ssd_mm,depth_mm,off_mm,value"), &["there twice"]);
    let decimal = table.replace(',', ";").replace('.', ",");
    refused(&decimal, &["decimal point"]);
}

#[test]
fn wrong_units_and_kinds_do_not_pass() {
    // Depths of centimetres in a column of millimetres.
    let cm = |text: &str, scale: f64| {
        let mut out = text.lines().next().unwrap().to_owned() + "\n";
        for (depth, dose) in depth_dose(5.0) {
            out += &format!("depth_dose,100,100,900,{},0,{dose}\n", depth * scale);
        }
        out
    };
    let table = depth_dose_table(5.0);
    refused(&cm(&table, 0.1), &["ends at 30.0 mm", "check the unit"]);
    refused(&cm(&table, 10.0), &["the place is 450", "mm"]);
    refused(
        &table.replace(",100,100,900", ",10,10,90"),
        &["the distance from the source to the surface is 90"],
    );
    refused(&table.replace(",100,100,900", ",1,1,900"), &["the side of the field is 1"]);
    let head = "kind,field_x_mm,field_y_mm,ssd_mm,depth_mm,off_mm,value\n";
    let lines = |field: f64, scale: f64, shift: f64| {
        let line = |(x, dose): (f64, f64)| {
            format!("profile_x,{field},{field},900,100,{},{dose}\n", x * scale + shift)
        };
        head.to_owned() + &profile().into_iter().map(line).collect::<String>()
    };
    assert_eq!(
        only("p.csv", &lines(100.0, 1.0, 0.4)).edges().unwrap().map(|x| (10.0 * x).round()),
        [-496.0, 504.0]
    );
    refused(&lines(100.0, 0.1, 0.0), &["the width at half of the dose on the axis is 10.0 mm"]);
    refused(&lines(60.0, 1.0, 0.0), &["the width at half"]);
    refused(&lines(100.0, 1.0, 5.0), &["the middle of the profile is 5.0 mm"]);
    // A depth dose of the wrong kind, and a half profile.
    refused(&table.replace("depth_dose", "profile_x"), &["the curve has 1 points (at least 12)"]);
    let half: Vec<String> =
        lines(100.0, 1.0, 0.0).lines().filter(|l| !l.contains(",-")).map(String::from).collect();
    refused(&half.join("\n"), &["a side of the profile does not fall"]);
}

#[test]
fn a_curve_in_two_parts_other_energies_and_empty_files_are_refused() {
    let table = depth_dose_table(5.0);
    let reading = "output,100,100,900,100,0,1\n";
    let row = "depth_dose,100,100,900,305,0,20\n";
    refused(&format!("{table}{reading}{row}"), &["line 64", "began before at line 2"]);
    refused("", &["no curve"]);
    refused("depth,dose\n1,2\n", &["not a file of measured doses"]);
    refused("kind,field_x_mm,field_y_mm,ssd_mm,depth_mm,off_mm,value\n", &["no curve"]);
    assert!(read("x", &[0xff, 0xfe, 0x00]).unwrap_err().to_string().contains("byte 0 is not UTF-8"));
    let energy = |mv: f64| {
        let lines = table.lines().enumerate();
        let text: Vec<String> = lines
            .map(|(i, line)| if i == 0 { format!("{line},energy_mv") } else { format!("{line},{mv}") })
            .collect();
        read(&format!("{mv}.csv"), text.join("\n").as_bytes()).unwrap()
    };
    let mut measured = Measured::default();
    measured.add(energy(6.0)).unwrap();
    let message = measured.add(energy(10.0)).unwrap_err().to_string();
    assert!(message.contains("10 MV, and 6 MV in 6.csv"), "{message}");
    assert!(!fault("kind\n").is_empty());
}
