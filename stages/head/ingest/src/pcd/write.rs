//! PCD files from points: fields x, y and z as 32-bit floats.

use std::fmt::Write;

fn header(points: usize, width: usize, encoding: &str) -> String {
    let width = width.max(1);
    let (width, height) = if points.is_multiple_of(width) { (width, points / width) } else { (points, 1) };
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n\
         COUNT 1 1 1\nWIDTH {width}\nHEIGHT {height}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {encoding}\n"
    )
}

/// An ascii PCD file of row-major `points`, `width` to a row; a width that does not divide them makes one row.
/// Numbers are written so that reading gives the same bits back.
#[must_use]
pub fn write_ascii(points: &[[f32; 3]], width: usize) -> String {
    let mut file = header(points.len(), width, "ascii");
    for [x, y, z] in points {
        // Writing to a string cannot fail.
        let _ = writeln!(file, "{x} {y} {z}");
    }
    file
}

/// A binary PCD file of row-major `points`, `width` to a row; a width that does not divide them makes one row.
#[must_use]
pub fn write_binary(points: &[[f32; 3]], width: usize) -> Vec<u8> {
    let mut file = header(points.len(), width, "binary").into_bytes();
    file.extend(points.iter().flatten().flat_map(|c| c.to_le_bytes()));
    file
}
