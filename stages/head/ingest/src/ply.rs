//! Point clouds in PLY files, text or binary: the vertices, without their other properties and their faces.

use stillpoint_patient::ply::{Encoding, Ply};

use crate::checks;

pub use stillpoint_patient::ply::PlyError;

/// Reads the vertices of a file, in the unit of the file. Those without a measurement are
/// [`INVALID_POINT`](crate::INVALID_POINT).
///
/// Text behind the vertices must be the rows that the header says, since a missing vertex would make one of the row behind
/// it; binary faces that are cut off leave the vertices whole.
///
/// # Errors
/// What is wrong with the file, and where.
///
/// ```
/// let file = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n\
///              0.1 -0.2 0.9\n";
/// assert_eq!(stillpoint_ingest::ply::read(file)?, [[0.1, -0.2, 0.9]]);
/// # Ok::<(), stillpoint_ingest::ply::PlyError>(())
/// ```
pub fn read(bytes: &[u8]) -> Result<Vec<[f32; 3]>, PlyError> {
    let mut ply = Ply::open(bytes)?;
    let elements = ply.elements().to_vec();
    let place = elements.iter().position(|e| e.name == "vertex").ok_or(PlyError::NoVertices)?;
    let axes = elements[place].axes().ok_or(PlyError::NoVertices)?;
    let mut points = Vec::with_capacity(elements[place].rows);
    let is_binary = ply.encoding() != Encoding::Ascii;
    for (number, element) in elements.iter().enumerate() {
        let columns = if number == place { &axes[..] } else { &[] };
        let read = ply.rows::<PlyError>(element, columns, |_, cells| {
            if let [x, y, z] = cells {
                points.push(checks::point([x, y, z].map(|cell| cell[0].single)));
            }
            Ok(())
        });
        match read {
            Err(_) if number > place && is_binary => return Ok(points),
            read => read?,
        }
    }
    ply.end()?;
    Ok(points)
}
