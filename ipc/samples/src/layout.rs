//! The field table behind a sample's bytes: sizes, hash and message text.

use crate::names::Names;
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

/// A number as it lies in memory, in a recording and on the wire: little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Primitive {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl Primitive {
    /// Bytes of one value, which is also its alignment.
    pub const fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// One value out of its little-endian bytes; integers beyond 2^53 are rounded.
    pub fn as_f64(self, bytes: &[u8]) -> f64 {
        let mut wide = [0_u8; 8];
        let n = bytes.len().min(8);
        wide[..n].copy_from_slice(&bytes[..n]);
        let bits = u64::from_le_bytes(wide);
        match self {
            Self::F64 => f64::from_bits(bits),
            Self::F32 => f64::from(f32::from_bits(bits as u32)),
            Self::I8 => f64::from(bits as u8 as i8),
            Self::I16 => f64::from(bits as u16 as i16),
            Self::I32 => f64::from(bits as u32 as i32),
            Self::I64 => bits as i64 as f64,
            Self::U8 | Self::U16 | Self::U32 | Self::U64 => bits as f64,
        }
    }

    /// Name of the type in a `ros2msg` schema.
    pub const fn ros_name(self) -> &'static str {
        match self {
            Self::U8 => "uint8",
            Self::I8 => "int8",
            Self::U16 => "uint16",
            Self::I16 => "int16",
            Self::U32 => "uint32",
            Self::I32 => "int32",
            Self::U64 => "uint64",
            Self::I64 => "int64",
            Self::F32 => "float32",
            Self::F64 => "float64",
        }
    }
}

/// One field of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Name, as in the struct.
    pub name: &'static str,
    /// Type of the value, or of each value of the array.
    pub primitive: Primitive,
    /// Length of the array; 0 for a single value.
    pub array: usize,
    /// Unit of the value (`m`, `rad`, `s`, ...); empty for a plain number.
    pub unit: &'static str,
    /// What its numbers mean. Names are for readers: they are no part of the layout hash.
    pub names: Names,
    /// What it holds, in a sentence.
    pub about: &'static str,
}

impl Field {
    /// A field without names.
    pub const fn new(name: &'static str, primitive: Primitive, array: usize, unit: &'static str) -> Self {
        Self { name, primitive, array, unit, names: Names::None, about: "" }
    }

    /// Bytes of the field.
    pub const fn size(&self) -> usize {
        self.primitive.size() * if self.array == 0 { 1 } else { self.array }
    }
}

/// Bytes of a struct with these fields and no padding.
pub const fn fields_size(fields: &[Field]) -> usize {
    let (mut sum, mut i) = (0, 0);
    while i < fields.len() {
        sum += fields[i].size();
        i += 1;
    }
    sum
}

/// Plain bytes with a known field table. Derive it with `#[derive(Layout)]`.
pub trait Layout: FromBytes + IntoBytes + Immutable + KnownLayout + Copy + 'static {
    /// The fields in the order of their bytes. Empty for a bare number (see [`Layout::BARE`]) and for `()`.
    const FIELDS: &'static [Field];
    /// The number itself, where the layout is a bare number rather than a struct.
    const BARE: Option<Primitive> = None;
}

impl Layout for () {
    const FIELDS: &'static [Field] = &[];
}

impl Layout for u16 {
    const FIELDS: &'static [Field] = &[];
    const BARE: Option<Primitive> = Some(Primitive::U16);
}

impl Layout for u8 {
    const FIELDS: &'static [Field] = &[];
    const BARE: Option<Primitive> = Some(Primitive::U8);
}

const FNV_OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const FNV_PRIME: u64 = 0x0000_0100_0000_01b3;

/// FNV-1a of `text`, going on from `hash`, closed by a separator so that ("ab","c") differs from ("a","bc").
pub const fn fnv1a(mut hash: u64, text: &[u8]) -> u64 {
    let mut i = 0;
    while i < text.len() {
        hash = (hash ^ text[i] as u64).wrapping_mul(FNV_PRIME);
        i += 1;
    }
    (hash ^ 0xff).wrapping_mul(FNV_PRIME)
}

/// Start value of [`fnv1a`].
pub const fn fnv1a_start() -> u64 {
    FNV_OFFSET
}

/// Hash of a field table: names, types, array lengths and units, in order.
pub const fn hash_fields(mut hash: u64, fields: &[Field]) -> u64 {
    let mut i = 0;
    while i < fields.len() {
        let f = &fields[i];
        hash = fnv1a(hash, f.name.as_bytes());
        hash = fnv1a(hash, f.primitive.ros_name().as_bytes());
        hash = fnv1a(hash, &(f.array as u64).to_le_bytes());
        hash = fnv1a(hash, f.unit.as_bytes());
        i += 1;
    }
    hash
}
