//! Which field of which sample differs, and by how much.

use serde::Serialize;
use stillpoint_samples::{Entry, Field, HEADER_FIELDS, HEADER_SIZE, Primitive, RefKind, SampleKind};

/// Where something differs, and both values.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Name of the operator.
    pub operator: String,
    /// Its incarnation.
    pub incarnation: u32,
    /// Number of the activation.
    pub activation: u64,
    /// The topic.
    pub topic: String,
    /// Sequence of the sample, or of the journal entry.
    pub sequence: u64,
    /// The field, with its place: `elements[3].xyz[1]`.
    pub field: String,
    /// The value in the recording.
    pub recorded: String,
    /// The value made again.
    pub replayed: String,
    /// Distance in units in the last place, for floating-point fields.
    pub ulps: Option<u64>,
}

/// Where a comparison takes place.
pub struct Place<'a> {
    /// Name of the operator.
    pub operator: &'a str,
    /// The entry of the activation.
    pub entry: &'a Entry,
    /// The topic.
    pub topic: &'a str,
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "operator {}, incarnation {}, activation {}: {} {} differs in {}: recorded {}, replayed {}",
            self.operator,
            self.incarnation,
            self.activation,
            self.topic,
            self.sequence,
            self.field,
            self.recorded,
            self.replayed
        )?;
        match self.ulps {
            Some(1) => write!(f, " (1 ulp apart)"),
            Some(n) => write!(f, " ({n} ulps apart)"),
            None => Ok(()),
        }
    }
}

impl Difference {
    fn at(place: &Place<'_>, sequence: u64, field: &str, recorded: String, replayed: String) -> Self {
        Self {
            operator: place.operator.to_string(),
            incarnation: place.entry.header.incarnation,
            activation: place.entry.body.index,
            topic: place.topic.to_string(),
            sequence,
            field: field.to_string(),
            recorded,
            replayed,
            ulps: None,
        }
    }

    /// The first difference of two samples of a kind that are not the same bytes.
    pub fn of_samples(place: &Place<'_>, kind: &SampleKind, recorded: &[u8], replayed: &[u8]) -> Self {
        let sequence = recorded.get(16..24).and_then(|b| b.try_into().ok()).map_or(0, u64::from_le_bytes);
        let common = recorded.len().min(replayed.len());
        let Some(at) = (0..common).find(|i| recorded[*i] != replayed[*i]) else {
            let bytes = |n: usize| format!("{n} bytes");
            return Self::at(place, sequence, "length", bytes(recorded.len()), bytes(replayed.len()));
        };
        let (name, start, primitive) = field_at(kind, at);
        let values = |b: &[u8]| value(primitive, b.get(start..start + primitive.size()).unwrap_or(&[]));
        let ((a, a_bits), (b, b_bits)) = (values(recorded), values(replayed));
        let mut found = Self::at(place, sequence, &name, a, b);
        if let (Some(a), Some(b)) = (a_bits, b_bits) {
            found.ulps = Some(a.abs_diff(b));
        }
        found
    }

    /// The first difference of what two entries say of outcome, origin and outputs.
    pub fn of_entries(place: &Place<'_>, recorded: &Entry, replayed: &Entry) -> Option<Self> {
        let sequence = recorded.header.sequence;
        let text = |e: &Entry| e.outcome().map_or_else(|| e.body.outcome.to_string(), |o| format!("{o:?}"));
        if recorded.body.outcome != replayed.body.outcome {
            return Some(Self::at(place, sequence, "outcome", text(recorded), text(replayed)));
        }
        if recorded.body.index != replayed.body.index {
            let index = |e: &Entry| e.body.index.to_string();
            return Some(Self::at(place, sequence, "index", index(recorded), index(replayed)));
        }
        if recorded.header.origin != replayed.header.origin {
            let origin = |e: &Entry| e.header.origin.to_string();
            return Some(Self::at(place, sequence, "origin", origin(recorded), origin(replayed)));
        }
        // An output on which nothing was sent so far is as one that the build of the recording did not have.
        let outputs = |e: &Entry| {
            let sent = e.refs_of(RefKind::Output).filter(|r| r.first > 0 || r.count > 0 || r.lost > 0);
            sent.map(|r| (r.port, r.first, r.count)).collect::<Vec<_>>()
        };
        let (a, b) = (outputs(recorded), outputs(replayed));
        (a != b).then(|| {
            let say = |refs: &[(u32, u64, u32)]| {
                let one =
                    |(port, first, count): &(u32, u64, u32)| format!("{count} from {first} on output {port}");
                if refs.is_empty() {
                    "nothing".to_string()
                } else {
                    refs.iter().map(one).collect::<Vec<_>>().join(", ")
                }
            };
            Self::at(place, sequence, "outputs", say(&a), say(&b))
        })
    }
}

/// Name, first byte and type of the value that holds byte `at` of a sample.
fn field_at(kind: &SampleKind, at: usize) -> (String, usize, Primitive) {
    let (fields, prefix, base) = if at < HEADER_SIZE {
        (HEADER_FIELDS, "header.".to_string(), 0)
    } else if at < kind.meta_size() {
        (kind.body, "body.".to_string(), HEADER_SIZE)
    } else {
        let element = (at - kind.meta_size()) / kind.element_size.max(1);
        let base = kind.meta_size() + element * kind.element_size;
        if let Some(primitive) = kind.bare {
            return (format!("elements[{element}]"), base, primitive);
        }
        (kind.element, format!("elements[{element}]."), base)
    };
    let mut start = base;
    for field in fields {
        let Field { name, primitive, array, .. } = field;
        let size = field.size();
        if at < start + size {
            let index = (at - start) / primitive.size();
            let name =
                if *array == 0 { format!("{prefix}{name}") } else { format!("{prefix}{name}[{index}]") };
            return (name, start + index * primitive.size(), *primitive);
        }
        start += size;
    }
    (prefix, at, Primitive::U8)
}

/// A value as text, and its place among floating-point numbers where it is one.
fn value(primitive: Primitive, bytes: &[u8]) -> (String, Option<u64>) {
    let mut wide = [0u8; 8];
    let n = bytes.len().min(8);
    wide[..n].copy_from_slice(&bytes[..n]);
    let bits = u64::from_le_bytes(wide);
    // Ordered so that neighbours differ by one, also across zero.
    let order64 = |b: u64| if b >> 63 == 1 { !b } else { b | 1 << 63 };
    let order32 = |b: u32| if b >> 31 == 1 { !b } else { b | 1 << 31 };
    match primitive {
        Primitive::F64 => (format!("{:?} (0x{bits:016x})", f64::from_bits(bits)), Some(order64(bits))),
        Primitive::F32 => {
            let bits = bits as u32;
            (format!("{:?} (0x{bits:08x})", f32::from_bits(bits)), Some(u64::from(order32(bits))))
        }
        Primitive::I8 => ((bits as u8 as i8).to_string(), None),
        Primitive::I16 => ((bits as u16 as i16).to_string(), None),
        Primitive::I32 => ((bits as u32 as i32).to_string(), None),
        Primitive::I64 => ((bits as i64).to_string(), None),
        _ => (bits.to_string(), None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_samples::{Header, JournalBody, JournalRef};

    fn found(recorded: &[JournalRef], replayed: &[JournalRef]) -> Option<Difference> {
        let entry = |refs: &[JournalRef]| Entry {
            header: Header::default(),
            body: JournalBody::default(),
            refs: refs.to_vec(),
        };
        let (recorded, replayed) = (entry(recorded), entry(replayed));
        let place = Place { operator: "head", entry: &recorded, topic: "head.journal" };
        Difference::of_entries(&place, &recorded, &replayed)
    }

    #[test]
    fn an_output_on_which_nothing_was_sent_may_be_newer_than_the_recording_and_no_other() {
        let output = |port, first, count| JournalRef {
            first,
            count,
            port,
            kind: RefKind::Output as u32,
            ..JournalRef::default()
        };
        assert_eq!(found(&[output(0, 30, 0)], &[output(0, 30, 0), output(4, 0, 0)]), None);
        for other in [output(4, 0, 1), output(4, 1, 0)] {
            let difference = found(&[output(0, 30, 0)], &[output(0, 30, 0), other]).unwrap();
            assert_eq!(difference.field, "outputs");
        }
        assert!(found(&[output(0, 30, 0)], &[]).is_some());
    }
}
