//! STL, binary and text: triangles without shared corners. Millimetres, by custom. The header of a binary file has room
//! for the isocentre.

use std::collections::BTreeMap;
use std::io::{self, Write};

use super::{Mesh, MeshError, MeshFile, Placing};

const HEADER: usize = 80;
const TRIANGLE: usize = 50;

/// Writes a mesh, mm, as binary STL.
///
/// # Errors
/// Those of `to`.
pub fn write_stl(mesh: &Mesh, placing: &Placing, to: &mut impl Write) -> io::Result<()> {
    let [x, y, z] = placing.isocentre_mm;
    let text =
        format!("stillpoint mm isocentre_mm {x:.3} {y:.3} {z:.3} position {}", placing.position.term());
    let mut header = [0_u8; HEADER];
    for (slot, byte) in header.iter_mut().zip(text.bytes()) {
        *slot = byte;
    }
    to.write_all(&header)?;
    to.write_all(&(mesh.triangles.len() as u32).to_le_bytes())?;
    for triangle in &mesh.triangles {
        let [a, b, c] = mesh.corners(triangle);
        let normal = (b - a).cross(&(c - a)).try_normalize(1e-12).unwrap_or_default();
        for vector in [normal, a, b, c] {
            for number in vector.iter() {
                to.write_all(&(*number as f32).to_le_bytes())?;
            }
        }
        to.write_all(&[0, 0])?;
    }
    Ok(())
}

/// Reads a mesh, and what a header of stillpoint says of its place.
///
/// # Errors
/// What is wrong, with its line or the bytes that are due.
pub fn read_stl(bytes: &[u8]) -> Result<MeshFile, MeshError> {
    let count = bytes.get(HEADER..HEADER + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let length = count.map(|n| HEADER + 4 + TRIANGLE * n as usize);
    if length == Some(bytes.len()) {
        let number = |at: usize| -> f64 {
            f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]).into()
        };
        let corners = bytes[HEADER + 4..].chunks_exact(TRIANGLE).enumerate().flat_map(|(i, _)| {
            let at = HEADER + 4 + TRIANGLE * i + 12;
            [0, 12, 24].map(|corner| [0, 4, 8].map(|c| number(at + corner + c)))
        });
        let header: String = bytes[..HEADER].iter().map(|b| char::from(*b)).collect();
        let (isocentre_mm, position) = placed(&header);
        return Ok(MeshFile { mesh: joined(corners)?, isocentre_mm, position });
    }
    if !bytes.starts_with(b"solid") {
        return Err(MeshError::Short { expected: length.unwrap_or(HEADER + 4), found: bytes.len() });
    }
    let mut corners = Vec::new();
    for (line, text) in String::from_utf8_lossy(bytes).lines().enumerate() {
        let Some(rest) = text.trim().strip_prefix("vertex") else { continue };
        let numbers: Vec<f64> = rest.split_whitespace().filter_map(|w| w.parse().ok()).collect();
        let corner = <[f64; 3]>::try_from(numbers).map_err(|_| MeshError::Line {
            line: line + 1,
            why: format!("{:?} has no three numbers", text.trim()),
        })?;
        corners.push(corner);
    }
    if corners.len() % 3 != 0 {
        return Err(MeshError::Short { expected: 3 * (corners.len() / 3 + 1), found: corners.len() });
    }
    Ok(MeshFile { mesh: joined(corners.into_iter())?, isocentre_mm: None, position: None })
}

/// What the header says, after its words.
fn placed(header: &str) -> (Option<[f64; 3]>, Option<String>) {
    let words: Vec<&str> = header.split([' ', '\0']).filter(|w| !w.is_empty()).collect();
    let after = |word: &str| words.iter().position(|w| *w == word).map(|at| &words[at + 1..]);
    let isocentre = after("isocentre_mm").and_then(|rest| {
        let numbers: Vec<f64> =
            rest.iter().take(3).filter_map(|w| w.parse().ok()).filter(|c: &f64| c.is_finite()).collect();
        numbers.try_into().ok()
    });
    (isocentre, after("position").and_then(|rest| rest.first()).map(|word| (*word).to_owned()))
}

/// Corners in threes as a mesh; equal corners become one.
fn joined(corners: impl Iterator<Item = [f64; 3]>) -> Result<Mesh, MeshError> {
    let mut known: BTreeMap<[u64; 3], u32> = BTreeMap::new();
    let mut vertices = Vec::new();
    let numbers: Vec<u32> = corners
        .map(|corner| {
            *known.entry(corner.map(|c| (c + 0.0).to_bits())).or_insert_with(|| {
                vertices.push(corner);
                vertices.len() as u32 - 1
            })
        })
        .collect();
    Mesh::checked(vertices, numbers.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::PatientPosition;

    #[test]
    fn what_is_written_is_read() {
        let mesh = Mesh::checked(
            vec![[0.5, -1.25, 2.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]],
            vec![[0, 1, 2], [1, 3, 2]],
        )
        .unwrap();
        let placing = Placing { isocentre_mm: [1.5, -2.0, 0.25], position: PatientPosition::HeadFirstSupine };
        let mut bytes = Vec::new();
        write_stl(&mesh, &placing, &mut bytes).unwrap();
        let isocentre_mm = Some([1.5, -2.0, 0.25]);
        assert_eq!(read_stl(&bytes), Ok(MeshFile { mesh, isocentre_mm, position: Some("HFS".into()) }));
        for end in 0..bytes.len() {
            assert!(read_stl(&bytes[..end]).is_err(), "{end}");
        }
    }

    #[test]
    fn text_is_read() {
        let text = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1e1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
        assert_eq!(read_stl(text.as_bytes()).unwrap().mesh.vertices_mm[1], [10.0, 0.0, 0.0]);
        let broken = text.replace("1e1 0 0", "1e1 0");
        assert!(read_stl(broken.as_bytes()).unwrap_err().to_string().starts_with("line 5: "));
    }
}
