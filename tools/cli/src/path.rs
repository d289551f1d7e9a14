//! A path to a value of a sample: `position.z`, `covariance[2][2]`, `[3].centroid.x`, `pose.pitch`.

use std::fmt::{Display, Formatter};

use stillpoint_pipeline::config::near::nearest;
use stillpoint_samples::{
    Diagnostics, Field, HEADER_FIELDS, HEADER_SIZE, Names, Pieces, Primitive, Sample, SampleKind, Shape,
};

use crate::number::{Number, parts_of, single_unit};

/// A path that exists in samples of one kind.
#[derive(Clone, Debug)]
pub struct ValuePath {
    text: String,
    place: Place,
}

#[derive(Clone, Debug)]
enum Place {
    /// A value, or all values of an array, of a field.
    Field { at: At, field: &'static Field, index: Option<usize> },
    /// A value of an element that is a bare number.
    Bare { element: usize },
    /// The number of this name in diagnostics.
    Metric(String),
    /// Pitch, roll or yaw of the quaternion at this place of the element.
    Angle { offset: usize, angle: usize },
}

/// Where a field is: which part of the sample, and its first byte in it.
#[derive(Clone, Copy, Debug)]
enum At {
    Header(usize),
    Body(usize),
    Element(usize, usize),
}

/// A value behind a path.
pub struct Found<'a> {
    /// The field with its names; `None` for a value that is computed or has no field.
    pub field: Option<&'static Field>,
    /// The unit of the values.
    pub unit: &'a str,
    /// The values: one, or those of an array.
    pub values: Vec<Number>,
    /// Whether the path names the whole array.
    pub is_array: bool,
}

/// What stands behind a path in every sample of its kind.
pub struct Values {
    /// The type of a value.
    pub primitive: Primitive,
    /// Whether the path names a whole array.
    pub is_array: bool,
    /// The unit of the values; a field with several units names all.
    pub unit: &'static str,
    /// What the numbers mean.
    pub names: Names,
}

/// A step of a path.
enum Step<'a> {
    Name(&'a str),
    Index(usize),
}

impl Display for ValuePath {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}

/// Why a text is not the path of a value of a sample.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PathError {
    /// It is not a path.
    #[error("invalid path: `{0}` (allowed: names and indices, such as position.z or covariance[2][2])")]
    Text(String),
    /// Samples of the kind have no such value.
    #[error("`{path}`: {fault}")]
    Place { path: String, fault: PathFault },
}

/// Why a path leads to no value of a sample.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PathFault {
    #[error("a {kind} has one element: leave out [{index}]")]
    OneElement { kind: &'static str, index: usize },
    #[error("write a field behind it; {0}")]
    NoField(String),
    #[error("an index follows a name")]
    Index,
    #[error("a pose has x, y, z, pitch, roll and yaw")]
    Pose,
    #[error("a {kind} has no field `{name}`{near}; {has}")]
    Field { kind: &'static str, name: String, near: String, has: String },
    #[error("invalid index of {field}: {index} (allowed: 0 to {most})")]
    Beyond { field: &'static str, index: usize, most: usize },
    #[error("{0} is one value: write nothing behind it")]
    OneValue(&'static str),
    #[error("{field} has no part `{part}`; it has {has}")]
    Part { field: &'static str, part: String, has: String },
    #[error("the values of {field} have no names: write {field}[0] in place of .{part}")]
    NoNames { field: &'static str, part: String },
    #[error("{field} has {values} values: write one index")]
    Values { field: &'static str, values: usize },
}

impl ValuePath {
    /// The path of this text in samples of a kind.
    ///
    /// # Errors
    /// Samples of this kind have no such value; the text names what they have.
    pub fn new(text: &str, kind: &'static SampleKind) -> Result<Self, PathError> {
        let steps = steps(text).ok_or_else(|| PathError::Text(text.to_owned()))?;
        let place = place(&steps, kind).map_err(|fault| PathError::Place { path: text.to_owned(), fault })?;
        Ok(Self { text: text.to_owned(), place })
    }

    /// What the values in samples of the kind are.
    pub fn values(&self, kind: &'static SampleKind) -> Values {
        let computed = |unit| Values { primitive: Primitive::F64, is_array: false, unit, names: Names::None };
        match &self.place {
            Place::Field { field, index, .. } => Values {
                primitive: field.primitive,
                is_array: field.array > 0 && index.is_none(),
                unit: index.map_or(field.unit, |index| single_unit(field, index)),
                names: field.names,
            },
            Place::Bare { .. } => Values {
                primitive: kind.bare.unwrap_or(Primitive::U8),
                is_array: false,
                unit: "",
                names: Names::None,
            },
            Place::Metric(_) => computed(""),
            Place::Angle { .. } => computed("rad"),
        }
    }

    /// The value in a sample of the kind; `None` where the sample has fewer elements.
    pub fn find<'a>(&self, kind: &'static SampleKind, sample: Pieces<'a>) -> Option<Found<'a>> {
        match &self.place {
            Place::Field { at, field, index } => {
                let bytes = match at {
                    At::Header(offset) => sample.meta.get(*offset..)?,
                    At::Body(offset) => sample.meta.get(HEADER_SIZE + offset..)?,
                    At::Element(element, offset) => {
                        sample.payload.get(element * kind.element_size + offset..)?
                    }
                };
                let all = Number::all(field, bytes.get(..field.size())?);
                let Values { is_array, unit, .. } = self.values(kind);
                let values = match index {
                    Some(index) => vec![*all.get(*index)?],
                    None => all,
                };
                Some(Found { field: Some(field), unit, values, is_array })
            }
            Place::Bare { element } => {
                let size = kind.element_size;
                let bytes = sample.payload.get(element * size..(element + 1) * size)?;
                Some(Found {
                    field: None,
                    unit: "",
                    values: vec![Number::of(kind.bare?, bytes)],
                    is_array: false,
                })
            }
            Place::Metric(name) => {
                let view = sample.view::<Diagnostics>().ok()?;
                let value = view.elements.iter().find(|m| m.name() == name)?.value;
                Some(Found { field: None, unit: "", values: vec![Number::Float(value)], is_array: false })
            }
            Place::Angle { offset, angle } => {
                let bytes = sample.payload.get(*offset..offset + 32)?;
                let field = kind.element.iter().find(|f| f.size() == 32)?;
                let q: Vec<f64> = Number::all(field, bytes).into_iter().map(Number::float).collect();
                let angles = stillpoint_pose::angles([q[0], q[1], q[2], q[3]]).unwrap_or([f64::NAN; 3]);
                Some(Found {
                    field: None,
                    unit: "rad",
                    values: vec![Number::Float(angles[*angle])],
                    is_array: false,
                })
            }
        }
    }
}

fn steps(text: &str) -> Option<Vec<Step<'_>>> {
    let mut steps = Vec::new();
    for (number, dotted) in text.split('.').enumerate() {
        let (name, indices) = dotted.split_at(dotted.find('[').unwrap_or(dotted.len()));
        if name.is_empty() && (number > 0 || indices.is_empty()) {
            return None;
        }
        if !name.is_empty() {
            steps.push(Step::Name(name));
        }
        let mut rest = indices;
        while !rest.is_empty() {
            let (index, behind) = rest.strip_prefix('[')?.split_once(']')?;
            steps.push(Step::Index(index.parse().ok()?));
            rest = behind;
        }
    }
    Some(steps)
}

/// Index of the first byte of a field, and the field.
fn field_of(fields: &'static [Field], name: &str) -> Option<(usize, &'static Field)> {
    let at = fields.iter().position(|f| f.name == name)?;
    Some((fields[..at].iter().map(Field::size).sum(), &fields[at]))
}

fn place(steps: &[Step<'_>], kind: &'static SampleKind) -> Result<Place, PathFault> {
    let (element, steps) = match steps {
        [Step::Index(index), rest @ ..] => match kind.shape {
            Shape::Slice => (Some(*index), rest),
            Shape::Fixed => return Err(PathFault::OneElement { kind: kind.name, index: *index }),
        },
        all => (None, all),
    };
    let in_element = match kind.shape {
        Shape::Fixed => Some(0),
        Shape::Slice => element,
    };
    let Some((first, rest)) = steps.split_first() else {
        return match (element, kind.bare) {
            (Some(element), Some(_)) => Ok(Place::Bare { element }),
            _ => Err(PathFault::NoField(has(kind))),
        };
    };
    let Step::Name(name) = first else { return Err(PathFault::Index) };
    let found = match (element, in_element) {
        (Some(element), _) => field_of(kind.element, name).map(|(o, f)| (At::Element(element, o), f)),
        (None, in_element) => field_of(HEADER_FIELDS, name)
            .map(|(o, f)| (At::Header(o), f))
            .or_else(|| field_of(kind.body, name).map(|(o, f)| (At::Body(o), f)))
            .or_else(|| {
                in_element.and_then(|e| field_of(kind.element, name).map(|(o, f)| (At::Element(e, o), f)))
            }),
    };
    if let Some((at, field)) = found {
        return Ok(Place::Field { at, field, index: index_of(field, rest)? });
    }
    // The pose behind position and orientation: `pose.z`, `pose.pitch`.
    if *name == "pose"
        && let ([Step::Name(part)], Some(in_element)) = (rest, in_element)
        && let Some((offset, position)) = field_of(kind.element, "position")
    {
        if let Some(index) = parts_of(position).iter().position(|c| c.word == *part) {
            let at = At::Element(in_element, offset);
            return Ok(Place::Field { at, field: position, index: Some(index) });
        }
        let angle = ["pitch", "roll", "yaw"].iter().position(|a| a == part);
        if let (Some(angle), Some((offset, _))) = (angle, field_of(kind.element, "orientation")) {
            return Ok(Place::Angle { offset: in_element * kind.element_size + offset, angle });
        }
        if let (Some(index), Some((offset, field))) = (angle, field_of(kind.element, "angles")) {
            return Ok(Place::Field { at: At::Element(in_element, offset), field, index: Some(index) });
        }
        return Err(PathFault::Pose);
    }
    if *kind == *Diagnostics::KIND && rest.is_empty() {
        return Ok(Place::Metric((*name).to_owned()));
    }
    let names = HEADER_FIELDS.iter().chain(kind.body).chain(kind.element).map(|f| f.name);
    let near = nearest(name, names).map_or_else(String::new, |near| format!(", did you mean {near}?"));
    Err(PathFault::Field { kind: kind.name, name: (*name).to_owned(), near, has: has(kind) })
}

/// The fields of a kind, as the end of a message.
fn has(kind: &SampleKind) -> String {
    let named = |fields: &[Field], before: &str| -> Vec<String> {
        fields.iter().filter(|f| f.name != "reserved").map(|f| format!("{before}{}", f.name)).collect()
    };
    let element = if kind.shape == Shape::Slice { "[0]." } else { "" };
    let all = [named(kind.body, ""), named(kind.element, element)].concat();
    format!("it has {}", if all.is_empty() { "[0], its first number".to_owned() } else { all.join(", ") })
}

/// The index of a value of a field, by the steps behind its name.
fn index_of(field: &'static Field, steps: &[Step<'_>]) -> Result<Option<usize>, PathFault> {
    let beyond = |index: usize, of: usize| {
        Err(PathFault::Beyond { field: field.name, index, most: of.saturating_sub(1) })
    };
    match (steps, field.names) {
        ([], _) => Ok(None),
        (_, _) if field.array == 0 => Err(PathFault::OneValue(field.name)),
        ([Step::Index(row), Step::Index(column)], Names::Rows(rows, columns)) => {
            if *row >= rows {
                return beyond(*row, rows);
            }
            if *column >= columns {
                return beyond(*column, columns);
            }
            Ok(Some(row * columns + column))
        }
        ([Step::Index(index)], _) if *index < field.array => Ok(Some(*index)),
        ([Step::Index(index)], _) => beyond(*index, field.array),
        ([Step::Name(part)], Names::Parts(parts)) => {
            let all = || parts.iter().map(|c| c.word).collect::<Vec<_>>().join(", ");
            let at = parts.iter().position(|c| c.word == *part).filter(|at| *at < field.array);
            at.map(Some).ok_or_else(|| PathFault::Part {
                field: field.name,
                part: (*part).to_owned(),
                has: all(),
            })
        }
        ([Step::Name(part)], _) => Err(PathFault::NoNames { field: field.name, part: (*part).to_owned() }),
        _ => Err(PathFault::Values { field: field.name, values: field.array }),
    }
}

#[cfg(test)]
mod tests {
    use stillpoint_samples::{AlignedBytes, ClusterTable, Metric, Track};
    use zerocopy::IntoBytes;

    use super::*;

    fn track() -> AlignedBytes {
        let kind = Track::KIND;
        let mut bytes = AlignedBytes::zeroed(kind.total_size(1).unwrap_or(0));
        let mut put = |field: &str, index: usize, value: f64| {
            let (at, _) = field_of(kind.element, field).unwrap_or_else(|| panic!("{field}"));
            bytes[HEADER_SIZE + at + 8 * index..][..8].copy_from_slice(&value.to_le_bytes());
        };
        put("position", 2, 0.25);
        put("covariance", 26, 7.0);
        // A turn of 0.2 rad about x.
        put("orientation", 0, 0.1f64.cos());
        put("orientation", 1, 0.1f64.sin());
        bytes[28] = 1;
        bytes
    }

    #[test]
    fn paths_find_parts_matrix_values_and_the_pose() {
        let bytes = track();
        let sample = Pieces::split(Track::KIND, &bytes).unwrap_or_else(|e| panic!("{e}"));
        for (path, value, unit) in [
            ("position.z", 0.25, "m"),
            ("position[2]", 0.25, "m"),
            ("pose.z", 0.25, "m"),
            ("covariance[2][2]", 7.0, "m2, rad2, m2/s, rad2/s, m2/s2, rad2/s2"),
            ("pose.pitch", 0.2, "rad"),
        ] {
            let found = ValuePath::new(path, Track::KIND).map(|p| p.find(Track::KIND, sample));
            let Ok(Some(found)) = found else { panic!("{path} is not found") };
            assert!((found.values[0].float() - value).abs() < 1e-12, "{path}");
            assert_eq!(found.unit, unit, "{path}");
        }
    }

    #[test]
    fn a_path_that_is_not_there_is_refused_with_what_is_there() {
        for (path, why) in [
            ("positoin", "did you mean position?"),
            ("position.w", "it has x, y, z"),
            ("position[3]", "invalid index of position: 3 (allowed: 0 to 2)"),
            ("covariance[12][0]", "invalid index of covariance: 12 (allowed: 0 to 11)"),
            ("channels.x", "channels is one value"),
            ("[0].position", "leave out [0]"),
            ("pose.w", "a pose has x, y, z"),
            ("a..b", "invalid path"),
            ("a[", "invalid path"),
            ("", "invalid path"),
        ] {
            let Err(refused) = ValuePath::new(path, Track::KIND) else { panic!("{path} is found") };
            assert!(refused.to_string().contains(why), "{path}: {refused}");
        }
        let Err(refused) = ValuePath::new("centroid", ClusterTable::KIND) else { panic!("it is found") };
        assert!(refused.to_string().contains("[0].centroid"), "{refused}");
    }

    #[test]
    fn numbers_of_diagnostics_are_found_by_their_name() {
        let kind = Diagnostics::KIND;
        let metrics = [Metric::new("first", 1.0), Metric::new("second", 2.5)];
        let mut bytes = AlignedBytes::zeroed(kind.total_size(2).unwrap_or(0));
        bytes[28] = 2;
        bytes[HEADER_SIZE..].copy_from_slice(metrics.as_bytes());
        let sample = Pieces::split(kind, &bytes).unwrap_or_else(|e| panic!("{e}"));
        let found = |path| {
            ValuePath::new(path, kind).ok().and_then(|p| p.find(kind, sample)).map(|f| f.values[0].float())
        };
        assert_eq!((found("second"), found("[0].value"), found("third")), (Some(2.5), Some(1.0), None));
    }
}
