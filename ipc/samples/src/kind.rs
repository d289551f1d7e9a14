//! What a sample type is, typed (`Sample`) and at run time (`SampleKind`).

use std::fmt::Write;

use crate::layout::{Field, Layout, Primitive, fields_size, fnv1a, fnv1a_start, hash_fields};
use crate::names::Names;
use crate::{HEADER_FIELDS, HEADER_SIZE};

/// How many elements a sample has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Exactly one.
    Fixed,
    /// Any number up to the port's capacity.
    Slice,
}

/// A type of sample: `Header ++ Body ++ [Element]`.
///
/// A fixed sample has `Body = ()` and one element. A slice has elements behind a body that describes them all (`()` if
/// there is nothing to describe); a body ends in a `u32` named `length` that repeats the element count, so that the
/// bytes are a CDR sequence.
pub trait Sample: 'static {
    /// The values that a sample states once.
    type Body: Layout;
    /// What is repeated.
    type Element: Layout;
    /// Name in configs, recordings and errors.
    const NAME: &'static str;
    /// One element or many.
    const SHAPE: Shape;
    /// What the sample is for, in one line.
    const ABOUT: &'static str;
    /// The run-time form.
    const KIND: &'static SampleKind;
}

/// The run-time form of a sample type: all that transport, recorder and replay need to know.
#[derive(Debug, Eq)]
pub struct SampleKind {
    /// Name in configs, recordings and errors.
    pub name: &'static str,
    /// What the sample is for.
    pub about: &'static str,
    /// One element or many.
    pub shape: Shape,
    /// Fields of the body.
    pub body: &'static [Field],
    /// Fields of the element.
    pub element: &'static [Field],
    /// The element, where it is a bare number.
    pub bare: Option<Primitive>,
    /// Bytes of the body: a multiple of 8.
    pub body_size: usize,
    /// Bytes of one element.
    pub element_size: usize,
    /// Alignment of the element.
    pub element_align: usize,
    /// Hash of layout and units.
    pub hash: u64,
}

/// The hash covers names, types, arrays and units, so two kinds are compared without looking at each field: the
/// recorder compares them for every sample.
impl PartialEq for SampleKind {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self, other)
            || (self.hash == other.hash && self.name == other.name && self.shape == other.shape)
    }
}

/// Whether a name stands in both tables.
const fn share_a_name(a: &[Field], b: &[Field]) -> bool {
    let mut i = 0;
    while i < a.len() {
        let mut j = 0;
        while j < b.len() {
            if is_same(a[i].name.as_bytes(), b[j].name.as_bytes()) {
                return true;
            }
            j += 1;
        }
        i += 1;
    }
    false
}

const fn is_same(a: &[u8], b: &[u8]) -> bool {
    let mut same = a.len() == b.len();
    let mut i = 0;
    while same && i < a.len() {
        same = a[i] == b[i];
        i += 1;
    }
    same
}

impl SampleKind {
    /// The run-time form of `S`. Fails to compile where the bytes would not be a CDR body.
    pub const fn of<S: Sample>() -> Self {
        let body = S::Body::FIELDS;
        let body_size = size_of::<S::Body>();
        assert!(body_size == fields_size(body), "the body has padding");
        assert!(
            !share_a_name(HEADER_FIELDS, body)
                && (matches!(S::SHAPE, Shape::Slice) || !share_a_name(HEADER_FIELDS, S::Element::FIELDS)),
            "a field has the name of another, or of the header's: readers of recordings refuse that"
        );
        assert!(
            body_size.is_multiple_of(8),
            "the body's size must be a multiple of 8, or the elements lose their alignment"
        );
        match S::SHAPE {
            Shape::Fixed => {
                assert!(body_size == 0, "a fixed sample has no body: put its fields into the element")
            }
            Shape::Slice => {
                if !body.is_empty() {
                    let last = &body[body.len() - 1];
                    assert!(
                        matches!(last.primitive, Primitive::U32) && last.array == 0 && is_length(last.name),
                        "the body of a slice must end in `length: u32`: it is the CDR length of the sequence"
                    );
                }
            }
        }
        let mut hash = fnv1a(fnv1a_start(), S::NAME.as_bytes());
        hash = hash_fields(hash, body);
        hash = fnv1a(hash, b"|");
        hash = hash_fields(hash, S::Element::FIELDS);
        if let Some(p) = S::Element::BARE {
            hash = fnv1a(hash, p.ros_name().as_bytes());
        }
        Self {
            name: S::NAME,
            about: S::ABOUT,
            shape: S::SHAPE,
            body,
            element: S::Element::FIELDS,
            bare: S::Element::BARE,
            body_size,
            element_size: size_of::<S::Element>(),
            element_align: align_of::<S::Element>(),
            hash,
        }
    }

    /// Name with the layout hash: the contract between two builds.
    pub fn type_name(&self) -> String {
        format!("{}@{:016x}", self.name, self.hash)
    }

    /// Bytes of header and body: the user header of the shared-memory sample.
    pub const fn meta_size(&self) -> usize {
        HEADER_SIZE + self.body_size
    }

    /// Bytes of a whole sample with `count` elements, or `None` where that overflows.
    pub fn total_size(&self, count: u32) -> Option<usize> {
        (count as usize).checked_mul(self.element_size)?.checked_add(self.meta_size())
    }

    /// The `ros2msg` text of the CDR body `Header ++ Body ++ elements`. Units stand as comments; the codes and bits of a
    /// field stand as constants in front of it (`uint32 STATE_ARMED=1`), which change neither bytes nor hash.
    pub fn ros_schema(&self) -> String {
        let mut text = format!("# {}\n", self.about);
        let header = match (self.shape, self.body.is_empty()) {
            // The count is the sequence's own length.
            (Shape::Slice, true) => &HEADER_FIELDS[..HEADER_FIELDS.len() - 1],
            _ => HEADER_FIELDS,
        };
        push_fields(&mut text, header);
        match self.shape {
            Shape::Fixed => push_fields(&mut text, self.element),
            Shape::Slice => {
                push_fields(&mut text, self.body.split_last().map_or(&[][..], |(_, rest)| rest));
                match self.bare {
                    Some(p) => {
                        let _ = writeln!(text, "{}[] data", p.ros_name());
                    }
                    None => {
                        let _ = writeln!(text, "{}Element[] data", self.name);
                        let _ =
                            write!(text, "{}\nMSG: stillpoint_msgs/{}Element\n", "=".repeat(80), self.name);
                        push_fields(&mut text, self.element);
                    }
                }
            }
        }
        text
    }

    /// Name of the schema in a recording.
    pub fn schema_name(&self) -> String {
        format!("stillpoint_msgs/msg/{}", self.name)
    }
}

const fn is_length(name: &str) -> bool {
    let (a, b) = (name.as_bytes(), b"length");
    if a.len() != b.len() {
        return false;
    }
    let mut i = 0;
    while i < a.len() {
        if a[i] != b[i] {
            return false;
        }
        i += 1;
    }
    true
}

fn push_fields(text: &mut String, fields: &[Field]) {
    for f in fields {
        if let Names::Codes(codes) | Names::Bits(codes) = f.names {
            for code in codes {
                let name = format!("{}_{}", f.name, code.word).to_ascii_uppercase().replace(' ', "_");
                let _ = writeln!(text, "{} {name}={}", f.primitive.ros_name(), code.value);
            }
        }
        let array = if f.array == 0 { String::new() } else { format!("[{}]", f.array) };
        let unit = if f.unit.is_empty() { String::new() } else { format!("  # {}", f.unit) };
        let _ = writeln!(text, "{}{array} {}{unit}", f.primitive.ros_name(), f.name);
    }
}
