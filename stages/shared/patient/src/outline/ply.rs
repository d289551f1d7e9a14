//! PLY (Turk 1994): triangles in text or binary. The comments `isocentre_mm X Y Z` and `position HFS` place the mesh.

use std::io::{self, Write};

use super::{Mesh, MeshError, MeshFile, Placing};

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

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Text,
    Little,
    Big,
}

#[derive(Clone, Copy, PartialEq)]
enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

enum Property {
    One(Number, String),
    List(Number, Number, String),
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// Reads a mesh, and what the comments say of its place. Faces of more than three corners become fans.
///
/// # Errors
/// What is wrong, with its line; a mesh without faces.
pub fn read_ply(bytes: &[u8]) -> Result<MeshFile, MeshError> {
    let (mut format, mut elements) = (None, Vec::<Element>::new());
    let (mut isocentre_mm, mut position) = (None, None);
    let (mut at, mut line) = (0, 0);
    loop {
        line += 1;
        let fault = |why: String| MeshError::Line { line, why };
        let end = bytes[at..]
            .iter()
            .position(|b| *b == b'\n')
            .ok_or_else(|| fault("the header has no end".into()))?;
        let text =
            std::str::from_utf8(&bytes[at..at + end]).map_err(|_| fault("the header is no text".into()))?;
        at += end + 1;
        let words: Vec<&str> = text.split_whitespace().collect();
        match words[..] {
            ["ply"] if line == 1 => {}
            _ if line == 1 => return Err(fault("a PLY file begins with `ply`".into())),
            ["format", "ascii", _] => format = Some(Format::Text),
            ["format", "binary_little_endian", _] => format = Some(Format::Little),
            ["format", "binary_big_endian", _] => format = Some(Format::Big),
            ["comment", "isocentre_mm", x, y, z] => {
                let read = |c: &str| c.parse::<f64>().ok().filter(|c| c.is_finite());
                let (Some(x), Some(y), Some(z)) = (read(x), read(y), read(z)) else {
                    return Err(fault(format!("{text:?} has no three numbers")));
                };
                isocentre_mm = Some([x, y, z]);
            }
            ["comment", "position", word] => position = Some(word.to_owned()),
            ["element", name, count] => {
                let count = count.parse().map_err(|_| fault(format!("{count:?} is no count")))?;
                elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
            }
            ["property", ref rest @ ..] => {
                let property = property(rest).ok_or_else(|| fault(format!("{text:?} is no property")))?;
                let element = elements.last_mut().ok_or_else(|| fault("a property of no element".into()))?;
                element.properties.push(property);
            }
            ["end_header"] => break,
            [] | ["comment" | "obj_info", ..] => {}
            _ => return Err(fault(format!("{text:?} is not understood"))),
        }
    }
    let format = format.ok_or(MeshError::Line { line, why: "the header names no format".into() })?;
    let mut reader = Reader { bytes, at, format, line };
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for element in &elements {
        // Such elements take no bytes: nothing would end their reading before their count.
        if element.properties.is_empty() && element.count > 0 {
            return Err(MeshError::Line { line, why: format!("element {:?} has no property", element.name) });
        }
        for number in 0..element.count {
            let mut vertex = [f64::NAN; 3];
            for property in &element.properties {
                match property {
                    Property::One(kind, name) => {
                        let value = reader.number(*kind)?;
                        if let Some(axis) = ["x", "y", "z"].iter().position(|axis| axis == name) {
                            vertex[axis] = value;
                        }
                    }
                    Property::List(count, kind, name) => {
                        let length = reader.number(*count)?;
                        let mut corners = Vec::new();
                        for _ in 0..length as usize {
                            corners.push(reader.number(*kind)?);
                        }
                        if element.name == "face" && name.starts_with("vertex_ind") {
                            fan(&corners, number, &mut triangles)?;
                        }
                    }
                }
            }
            if element.name == "vertex" {
                vertices.push(vertex);
            }
        }
    }
    Ok(MeshFile { mesh: Mesh::checked(vertices, triangles)?, isocentre_mm, position })
}

fn fan(corners: &[f64], face: usize, triangles: &mut Vec<[u32; 3]>) -> Result<(), MeshError> {
    let corner = |c: f64| match (0.0..f64::from(u32::MAX)).contains(&c) {
        true => Ok(c as u32),
        false => Err(MeshError::Corner { triangle: face, corner: u64::MAX, vertices: 0 }),
    };
    for pair in corners.get(1..).unwrap_or_default().windows(2) {
        triangles.push([corner(corners[0])?, corner(pair[0])?, corner(pair[1])?]);
    }
    Ok(())
}

fn number(word: &str) -> Option<Number> {
    Some(match word {
        "char" | "int8" => Number::I8,
        "uchar" | "uint8" => Number::U8,
        "short" | "int16" => Number::I16,
        "ushort" | "uint16" => Number::U16,
        "int" | "int32" => Number::I32,
        "uint" | "uint32" => Number::U32,
        "float" | "float32" => Number::F32,
        "double" | "float64" => Number::F64,
        _ => return None,
    })
}

fn property(words: &[&str]) -> Option<Property> {
    match words {
        ["list", count, kind, name] => {
            Some(Property::List(number(count)?, number(kind)?, (*name).to_owned()))
        }
        [kind, name] => Some(Property::One(number(kind)?, (*name).to_owned())),
        _ => None,
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    format: Format,
    line: usize,
}

impl Reader<'_> {
    fn number(&mut self, kind: Number) -> Result<f64, MeshError> {
        if self.format == Format::Text {
            return self.word();
        }
        Ok(match kind {
            Number::I8 => f64::from(i8::from_le_bytes(self.take()?)),
            Number::U8 => f64::from(u8::from_le_bytes(self.take()?)),
            Number::I16 => f64::from(i16::from_le_bytes(self.take()?)),
            Number::U16 => f64::from(u16::from_le_bytes(self.take()?)),
            Number::I32 => f64::from(i32::from_le_bytes(self.take()?)),
            Number::U32 => f64::from(u32::from_le_bytes(self.take()?)),
            Number::F32 => f64::from(f32::from_le_bytes(self.take()?)),
            Number::F64 => f64::from_le_bytes(self.take()?),
        })
    }

    /// The next bytes, in little-endian order.
    fn take<const N: usize>(&mut self) -> Result<[u8; N], MeshError> {
        let end = self.at + N;
        let short = MeshError::Short { expected: end, found: self.bytes.len() };
        let mut taken: [u8; N] = self.bytes.get(self.at..end).and_then(|b| b.try_into().ok()).ok_or(short)?;
        self.at = end;
        if self.format == Format::Big {
            taken.reverse();
        }
        Ok(taken)
    }

    fn word(&mut self) -> Result<f64, MeshError> {
        while let Some(b) = self.bytes.get(self.at).filter(|b| b.is_ascii_whitespace()) {
            self.line += usize::from(*b == b'\n');
            self.at += 1;
        }
        let rest = &self.bytes[self.at.min(self.bytes.len())..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        let word = std::str::from_utf8(&rest[..length]).unwrap_or_default();
        self.at += length;
        word.parse()
            .map_err(|_| MeshError::Line { line: self.line + 1, why: format!("{word:?} is no number") })
    }
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
        assert_eq!(read_ply(broken.as_bytes()).unwrap_err().to_string(), "line 15: \"x\" is no number");
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
