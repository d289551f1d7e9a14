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
    for Comment { line, text } in ply.comments() {
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
    for element in ply.elements().to_vec() {
        let is_corners = |p: &Property| p.name.starts_with("vertex_ind") && p.is_list();
        match element.name.as_str() {
            "vertex" => {
                let axes = element.axes().ok_or(PlyError::NoVertices)?;
                ply.rows::<MeshError>(&element, &axes, |_, cells| {
                    vertices.push([0, 1, 2].map(|axis: usize| cells[axis][0].double));
                    Ok(())
                })?;
            }
            "face" => {
                let corners: Vec<usize> =
                    element.properties.iter().position(is_corners).into_iter().collect();
                ply.rows(&element, &corners, |number, cells| {
                    cells.iter().try_for_each(|corners| fan(corners, number, &mut triangles))
                })?;
            }
            _ => ply.rows::<MeshError>(&element, &[], |_, _| Ok(()))?,
        }
    }
    ply.end()?;
    Ok(MeshFile { mesh: Mesh::checked(vertices, triangles)?, isocentre_mm, position })
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
        assert_eq!(
            read_ply(broken.as_bytes()).unwrap_err().to_string(),
            "row 1 of its element `face` has `x`, which is not a number"
        );
        let surplus = String::from_utf8(text.to_vec()).unwrap().replace("face 1", "face 0");
        assert!(matches!(read_ply(surplus.as_bytes()), Err(MeshError::Ply(PlyError::Surplus(_)))));
        let points = surplus.replace("4 0 1 2 3\n", "");
        assert_eq!(read_ply(points.as_bytes()).unwrap_err(), MeshError::NoTriangles);
    }

    #[test]
    fn an_element_without_properties_is_refused_at_once() {
        let text = format!("ply\nformat ascii 1.0\nelement vertex {}\nend_header\n", usize::MAX);
        let why = read_ply(text.as_bytes()).unwrap_err().to_string();
        assert!(why.contains("`vertex` claims 18446744073709551615 rows, at most 0 can be there"), "{why}");
    }

    #[test]
    fn headers_of_other_programs_are_read_and_what_is_no_mesh_is_refused() {
        // Indented lines, upper-case axes, line ends of Windows.
        let text = "ply\r\n  format ascii 1.0\r\n\tcomment isocentre_mm 1 2 3\r\n element vertex 3\r\n property float X\r\n \
            property float Y\r\n property float Z\r\n element face 1\r\n property list uchar int vertex_indices\r\n \
            end_header\r\n0 0 0\r\n10 0 0\r\n0 10 0\r\n3 0 1 2\r\n";
        let read = read_ply(text.as_bytes()).unwrap();
        assert_eq!((read.isocentre_mm, read.mesh.vertices_mm[1]), (Some([1.0, 2.0, 3.0]), [10.0, 0.0, 0.0]));
        let refused = |from: &str, to: &str| read_ply(text.replace(from, to).as_bytes()).unwrap_err();
        assert_eq!(refused("10 0 0", "nan 0 0"), MeshError::NotFinite(1));
        // A missing vertex would make one of the face.
        assert!(matches!(refused("10 0 0\r\n", ""), MeshError::Ply(PlyError::Row { .. })));
        assert!(matches!(
            refused("3 0 1 2\r\n", "3 0 1 2\r\n3 0 1 2\r\n"),
            MeshError::Ply(PlyError::Surplus(_))
        ));
        assert!(matches!(refused("float Z", "float w"), MeshError::Ply(PlyError::NoVertices)));
    }
}
