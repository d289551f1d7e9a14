//! Samples of an older layout as this build has them: field by field, by name.
//!
//! A mapping is there only where it is exact: every field of this build stands in the recording with the same type, array
//! and unit. The order may be another, and what this build has no field for is left out. A field that the recording
//! lacks has no value that would be true, so such a layout is refused.

use std::collections::BTreeMap;

use stillpoint_samples::{Field, HEADER_FIELDS, HEADER_SIZE, Pieces, Primitive, SampleKind, Shape};

use stillpoint_cdr::Reader;

use crate::form::{Decoded, Fault, Form};

/// Fields that fill a struct up to its alignment: zeros, and of no meaning.
const FILLING: &str = "reserved";
/// The last field of a header.
const COUNT: &str = "count";
/// The last field of a body: the length of the sequence behind it.
const LENGTH: &str = "length";

/// A field as a recording's schema has it.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Recorded {
    primitive: Primitive,
    array: usize,
    unit: String,
    at: usize,
    size: usize,
}

/// The fields of a struct by name, and its bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Struct {
    fields: BTreeMap<String, Recorded>,
    size: usize,
}

/// Bytes of one struct that are bytes of another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Move {
    from: usize,
    to: usize,
    size: usize,
}

/// How samples of a recorded layout become samples of this build.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mapping {
    body_size: usize,
    element_size: usize,
    body: Vec<Move>,
    element: Vec<Move>,
    left_out: Vec<String>,
}

impl Mapping {
    /// The mapping of a recorded schema to a kind. `None`: none is exact.
    pub(crate) fn new(schema: &str, ours: &SampleKind) -> Option<Self> {
        // What stands as a standard message is not laid out by its schema alone.
        if !Form::of(ours).is_empty() {
            return None;
        }
        let (before, element) = match schema.split_once("\nMSG: ") {
            Some((before, behind)) => (before, Struct::read(behind.lines().skip(1))?),
            None => (schema, Struct::default()),
        };
        let mut lines: Vec<&str> = before.lines().filter(|l| is_field(l)).collect();
        let mut bare = None;
        let slice = lines.last().and_then(|l| l.strip_suffix("[] data"));
        if let Some(name) = slice {
            bare = primitive(name);
            lines.pop();
        }
        if slice.is_some() != (ours.shape == Shape::Slice) || bare != ours.bare {
            return None;
        }
        let mut fields = Struct::read(lines)?;
        // The count is the sequence's own length where no body stands between.
        let with_body = fields.fields.contains_key(COUNT);
        if slice.is_some() && !with_body {
            fields.add(COUNT, Primitive::U32, 0, "");
        }
        let mut at = 0;
        for f in HEADER_FIELDS {
            fields.fields.remove(f.name).filter(|there| there.is(f) && there.at == at)?;
            at += f.size();
        }
        fields.fields.values_mut().for_each(|f| f.at -= HEADER_SIZE);
        fields.size -= HEADER_SIZE;
        if slice.is_some() && with_body {
            fields.add(LENGTH, Primitive::U32, 0, "");
        }
        let mut left_out = Vec::new();
        let (body, element_moves) = match (ours.shape, ours.bare) {
            (Shape::Fixed, _) => (Vec::new(), fields.moves(ours.element, &mut left_out)?),
            (Shape::Slice, Some(p)) => {
                let whole = Move { from: 0, to: 0, size: p.size() };
                (fields.moves(ours.body, &mut left_out)?, vec![whole])
            }
            (Shape::Slice, None) => {
                (fields.moves(ours.body, &mut left_out)?, element.moves(ours.element, &mut left_out)?)
            }
        };
        let (body_size, element_size) = match (ours.shape, bare) {
            (Shape::Fixed, _) => (0, fields.size),
            (Shape::Slice, Some(p)) => (fields.size, p.size()),
            (Shape::Slice, None) => (fields.size, element.size),
        };
        (element_size > 0).then_some(Self { body_size, element_size, body, element: element_moves, left_out })
    }

    /// Fields of the recording that this build does not have.
    pub fn left_out(&self) -> &[String] {
        &self.left_out
    }

    /// A recorded message as a sample of this build.
    pub(crate) fn decode(&self, ours: &SampleKind, data: &[u8]) -> Result<Decoded<'static>, Fault> {
        let mut reader = Reader::new(data)?;
        let there = reader.raw(HEADER_SIZE + self.body_size, 1)?;
        let (header, body) = there.split_at(HEADER_SIZE);
        let count = Pieces { meta: header, payload: &[] }.header().count as usize;
        let size = count.checked_mul(self.element_size).ok_or(Fault::TooLarge)?;
        let elements = reader.raw(size, 1)?;
        let mut meta = vec![0; ours.meta_size()];
        meta[..HEADER_SIZE].copy_from_slice(header);
        shift(&self.body, body, &mut meta[HEADER_SIZE..]);
        let mut payload = vec![0; count * ours.element_size];
        let pairs = elements.chunks_exact(self.element_size).zip(payload.chunks_exact_mut(ours.element_size));
        pairs.for_each(|(from, to)| shift(&self.element, from, to));
        Pieces { meta: &meta, payload: &payload }.check(ours)?;
        if reader.rest() > 0 {
            return Err(Fault::Rest(reader.rest()));
        }
        Ok(Decoded { meta: meta.into(), payload: payload.into() })
    }
}

fn shift(moves: &[Move], from: &[u8], to: &mut [u8]) {
    for m in moves {
        to[m.to..m.to + m.size].copy_from_slice(&from[m.from..m.from + m.size]);
    }
}

impl Recorded {
    fn is(&self, f: &Field) -> bool {
        (self.primitive, self.array, &*self.unit) == (f.primitive, f.array, f.unit)
    }
}

impl Struct {
    /// Out of the lines of a schema. `None`: a line is no field of fixed size.
    fn read<'a>(lines: impl IntoIterator<Item = &'a str>) -> Option<Self> {
        let mut found = Self::default();
        for line in lines.into_iter().filter(|l| is_field(l)) {
            let (field, unit) = line.split_once("  # ").unwrap_or((line, ""));
            let (kind, name) = field.split_once(' ')?;
            let (kind, array) = match kind.strip_suffix(']').and_then(|k| k.split_once('[')) {
                Some((kind, length)) => (kind, length.parse().ok().filter(|n| *n > 0 && *n < 1 << 20)?),
                None => (kind, 0),
            };
            if !found.add(name, primitive(kind)?, array, unit) {
                return None;
            }
        }
        Some(found)
    }

    /// Adds a field behind the others; false where one of its name is there.
    fn add(&mut self, name: &str, primitive: Primitive, array: usize, unit: &str) -> bool {
        let size = primitive.size() * array.max(1);
        let field = Recorded { primitive, array, unit: unit.to_owned(), at: self.size, size };
        self.size += size;
        self.fields.insert(name.to_owned(), field).is_none()
    }

    /// What goes where in a struct with these fields. `None`: a field is missing, or is another.
    fn moves(&self, ours: &[Field], left_out: &mut Vec<String>) -> Option<Vec<Move>> {
        let (mut moves, mut to) = (Vec::new(), 0);
        for f in ours {
            if f.name != FILLING {
                let there = self.fields.get(f.name).filter(|there| there.is(f))?;
                moves.push(Move { from: there.at, to, size: there.size });
            }
            to += f.size();
        }
        let is_ours = |name: &str| name == FILLING || ours.iter().any(|f| f.name == name);
        left_out.extend(self.fields.keys().filter(|n| !is_ours(n)).cloned());
        Some(moves)
    }
}

/// Whether a line of a schema is a field, and no comment and no constant (`uint32 STATE_ARMED=1`).
pub(crate) fn is_field(line: &str) -> bool {
    let is_constant = line.split("  # ").next().is_some_and(|declared| declared.contains('='));
    !line.is_empty() && !line.starts_with('#') && !is_constant
}

fn primitive(name: &str) -> Option<Primitive> {
    use Primitive::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
    [U8, I8, U16, I16, U32, I32, U64, I64, F32, F64].into_iter().find(|p| p.ros_name() == name)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use stillpoint_samples::{ClusterTable, Plane, Sample};

    use super::*;

    /// The schema with its third line behind its last, which is another order of the same fields.
    fn turned(kind: &SampleKind) -> String {
        let text = kind.ros_schema();
        let mut lines: Vec<&str> = text.lines().collect();
        let at = lines.iter().position(|l| l.starts_with("uint32 count")).unwrap_or(0) + 1;
        let line = lines.remove(at);
        lines.push(line);
        lines.join("\n")
    }

    #[test]
    fn a_message_of_another_length_than_its_layout_is_refused() {
        let Some(mapping) = Mapping::new(&turned(Plane::KIND), Plane::KIND) else { panic!("it maps") };
        let mut data = vec![0; 4 + HEADER_SIZE + Plane::KIND.element_size];
        data[1] = 1;
        data[4 + 28] = 1;
        assert!(mapping.decode(Plane::KIND, &data).is_ok());
        let shorter = data[..data.len() - 1].to_vec();
        let longer = [&data[..], &[0]].concat();
        data[4 + 28] = 2;
        for data in [shorter, longer, data] {
            assert!(mapping.decode(Plane::KIND, &data).is_err());
        }
    }

    proptest! {
        #[test]
        fn no_schema_and_no_message_makes_it_panic(
            at in 0usize..2000, with in "[ -~\n]{0,12}", data in proptest::collection::vec(any::<u8>(), 0..300),
            slice in any::<bool>(),
        ) {
            let kind = if slice { ClusterTable::KIND } else { Plane::KIND };
            let mut text = kind.ros_schema();
            let at = at % text.len();
            if text.is_char_boundary(at) {
                let end = (at + with.len()).min(text.len());
                text.replace_range(at..end, &with);
            }
            let data = [&[0, 1, 0, 0], &data[..]].concat();
            if let Some(mapping) = Mapping::new(&text, kind) {
                let _ = mapping.decode(kind, &data);
            }
        }
    }
}
