//! PLY (Turk 1994): triangles in text or binary. The comments `isocentre_mm X Y Z` and `position HFS` place the mesh.

use std::io::{self, Write};

use super::{Mesh, MeshError, MeshFile, Placing};
use crate::ply::{Comment, Ply, PlyError, Property, Value};

/// Writes a mesh, mm, as binary PLY.
///
/// # Errors
/// Those of `to`.
pub fn write_ply(mesh: &Mesh, placing: &Placing, to: &mut impl Write) -> io::Result<()> {
    let [x, y, z] = placing.isocentre_mm;
    write!(
        to,
        "ply\nformat binary_little_endian 1.0\ncomment unit mm\ncomment isocentre_mm {x} {y} {z}\ncomment position {}\n\
         element vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n\
         property list uchar uint vertex_indices\nend_header\n",
        placing.position.term(),
        mesh.vertices_mm.len(),
        mesh.triangles.len()
    )?;
    for vertex in &mesh.vertices_mm {
        for c in vertex {
            to.write_all(&(*c as f32).to_le_bytes())?;
        }
    }
    for triangle in &mesh.triangles {
        to.write_all(&[3])?;
        for corner in triangle {
            to.write_all(&corner.to_le_bytes())?;
        }
    }
    Ok(())
}

/// Reads a mesh, and what the comments say of its place. Faces of more than three corners become fans.
///
/// # Errors
/// What is wrong, with its line; a mesh without faces.
pub fn read_ply(bytes: &[u8]) -> Result<MeshFile, MeshError> {
    let mut ply = Ply::open(bytes)?;
    let (mut isocentre_mm, mut position) = (None, None);
    for Comment { line, text } in &ply.comments {
        match text.split(' ').collect::<Vec<_>>()[..] {
            ["isocentre_mm", x, y, z] => {
                let read = |c: &str| c.parse::<f64>().ok().filter(|c| c.is_finite());
                let (Some(x), Some(y), Some(z)) = (read(x), read(y), read(z)) else {
                    return Err(MeshError::Line {
                        line: *line,
                        why: format!("{text:?} has no three numbers"),
                    });
                };
                isocentre_mm = Some([x, y, z]);
            }
            ["position", word] => position = Some(word.to_owned()),
            _ => {}
        }
    }
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for element in &ply.elements.clone() {
        let place = |is: &dyn Fn(&Property) -> bool| element.properties.iter().position(is);
        let axes = ["x", "y", "z"].map(|axis| place(&|p| p.name == axis && !p.is_list()));
        let corners = place(&|p| p.name.starts_with("vertex_ind") && p.is_list());
        ply.rows(element, |number, cells| {
            if element.name == "vertex" {
                let coordinate = |axis: Option<usize>| axis.map_or(f64::NAN, |place| cells[place][0].double);
                vertices.push(axes.map(coordinate));
            }
            match corners.filter(|_| element.name == "face") {
                Some(corners) => fan(&cells[corners], number, &mut triangles),
                None => Ok(()),
            }
        })?;
    }
    Ok(MeshFile { mesh: Mesh::checked(vertices, triangles)?, isocentre_mm, position })
}

impl From<PlyError> for MeshError {
    fn from(error: PlyError) -> Self {
        match error {
            PlyError::Line { line, why } => Self::Line { line, why },
            PlyError::Short { expected, found } => Self::Short { expected, found },
        }
    }
}

fn fan(corners: &[Value], face: usize, triangles: &mut Vec<[u32; 3]>) -> Result<(), MeshError> {
    let corner = |c: f64| match (0.0..f64::from(u32::MAX)).contains(&c) {
        true => Ok(c as u32),
        false => Err(MeshError::Corner { triangle: face, corner: u64::MAX, vertices: 0 }),
    };
    for pair in corners.get(1..).unwrap_or_default().windows(2) {
        triangles.push([corner(corners[0].double)?, corner(pair[0].double)?, corner(pair[1].double)?]);
    }
    Ok(())
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
        let placing = Placing { isocentre_mm: [1.5, -2.0, 1e-3], position: PatientPosition::FeetFirstProne };
        let mut bytes = Vec::new();
        write_ply(&mesh, &placing, &mut bytes).unwrap();
        let isocentre_mm = Some([1.5, -2.0, 1e-3]);
        assert_eq!(read_ply(&bytes), Ok(MeshFile { mesh, isocentre_mm, position: Some("FFP".into()) }));
        // Cut anywhere, it is refused.
        for end in 0..bytes.len() {
            assert!(read_ply(&bytes[..end]).is_err(), "{end}");
        }
    }

    #[test]
    fn text_with_normals_and_faces_of_four_corners_is_read() {
        let text = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float nx\nproperty double y\n\
            property float z\nelement face 1\nproperty list uchar int vertex_index\nend_header\n\
            0 9 0 0\n1 9 0 0\n1 9 1 0\n0 9 1 0\n4 0 1 2 3\n";
        let read = read_ply(text).unwrap();
        assert_eq!((read.isocentre_mm, read.position), (None, None));
        assert_eq!(read.mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(read.mesh.vertices_mm[2], [1.0, 1.0, 0.0]);
        let broken = String::from_utf8(text.to_vec()).unwrap().replace("4 0 1 2 3", "4 0 1 x 3");
        assert_eq!(read_ply(broken.as_bytes()).unwrap_err().to_string(), "line 15: \"x\" is not a number");
        let points = String::from_utf8(text.to_vec()).unwrap().replace("face 1", "face 0");
        assert_eq!(read_ply(points.as_bytes()).unwrap_err(), MeshError::NoTriangles);
    }

    #[test]
    fn an_element_without_properties_is_refused_at_once() {
        let text = format!("ply\nformat ascii 1.0\nelement vertex {}\nend_header\n", usize::MAX);
        let why = read_ply(text.as_bytes()).unwrap_err().to_string();
        assert_eq!(why, "line 4: element \"vertex\" has no property");
    }
}
