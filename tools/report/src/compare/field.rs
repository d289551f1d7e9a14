//! The differences of the numbers of a topic.

use std::collections::BTreeMap;

use serde::Serialize;
use stillpoint_samples::{
    Diagnostics, Field, HEADER_SIZE, Names, Pieces, Primitive, Sample, SampleKind, Shape,
};

use crate::thinned::Thinned;

/// The longest array of which each value is compared by itself; the values of a longer one are compared together.
const MOST_PARTS: usize = 6;
/// Points of a curve.
const MOST_POINTS: usize = 2000;

/// How a difference goes on, from the first quarter of the time behind its begin to the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Trend {
    /// Twice as large at least.
    Grows,
    /// Half as large at most.
    Fades,
    /// Neither.
    Stays,
}

/// How a field differs in two sessions.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FieldDifference {
    /// Its name: `position.z`, or the name of a metric.
    pub field: String,
    /// Its unit; empty for a plain number.
    pub unit: String,
    /// Pairs of samples in which it differs.
    pub samples: u64,
    /// Root mean square of the second value minus the first one since the first difference; none of codes and texts.
    pub rms: Option<f64>,
    /// The difference of the largest size.
    pub worst: Option<f64>,
    /// Session time of it, s.
    pub worst_s: Option<f64>,
    /// Session time of the first difference, s.
    pub since_s: f64,
    /// Values of which one is not a number.
    pub unknown: u64,
    /// How the difference goes on; none where there are too few samples, or no numbers.
    pub trend: Option<Trend>,
}

/// The numbers of a field in both runs over time.
#[derive(Clone, Debug)]
pub struct Curves {
    /// The field.
    pub field: String,
    /// Its unit.
    pub unit: String,
    /// Time, s, with the value in the first and the second session.
    pub points: Vec<(f64, [f64; 2])>,
}

/// A value of a sample, or several that are compared together.
struct Slot {
    name: String,
    unit: String,
    /// Bytes from the start of the body or the element.
    at: usize,
    count: usize,
    primitive: Primitive,
    is_code: bool,
}

#[derive(Default)]
struct Sum {
    unit: String,
    samples: u64,
    values: u64,
    squares: f64,
    worst: Option<(f64, u64)>,
    since: Option<u64>,
    unknown: u64,
    is_code: bool,
    /// Time and square of the difference since the first one.
    course: Thinned<(u64, f64)>,
    curve: Option<Thinned<(u64, [f64; 2])>>,
}

/// The fields of a topic.
pub(super) struct Fields {
    kind: &'static SampleKind,
    body: Vec<Slot>,
    element: Vec<Slot>,
    /// By place in the layout, and by name.
    sums: BTreeMap<(usize, String), Sum>,
}

impl Fields {
    pub fn new(kind: &'static SampleKind) -> Self {
        let (body, element) = (
            slots(kind.body),
            match kind.bare {
                Some(primitive) => vec![Slot {
                    name: "data".to_owned(),
                    unit: String::new(),
                    at: 0,
                    count: 1,
                    primitive,
                    is_code: false,
                }],
                None => slots(kind.element),
            },
        );
        Self { kind, body, element, sums: BTreeMap::new() }
    }

    /// Takes a pair of the same bytes.
    pub fn same(&mut self, at: u64, sample: Pieces<'_>) {
        if self.has_curves() {
            self.values(at, sample, sample);
        }
    }

    /// Takes a pair of different bytes. Gives the first field that differs; none where only the header does.
    pub fn compare(&mut self, at: u64, first: Pieces<'_>, second: Pieces<'_>) -> Option<String> {
        self.values(at, first, second)
    }

    /// Samples with one set of numbers have curves.
    fn has_curves(&self) -> bool {
        self.kind.shape == Shape::Fixed || *self.kind == *Diagnostics::KIND
    }

    fn values(&mut self, at: u64, first: Pieces<'_>, second: Pieces<'_>) -> Option<String> {
        if *self.kind == *Diagnostics::KIND {
            return self.metrics(at, first, second);
        }
        let mut found = None;
        let has_curves = self.has_curves();
        let bodies = [first, second].map(|p| p.meta.get(HEADER_SIZE..).unwrap_or(&[]));
        let [one, other] = [first, second].map(|p| p.payload.len() / self.kind.element_size.max(1));
        for (place, slot) in self.body.iter().enumerate() {
            let sum = self.sums.entry((place, slot.name.clone())).or_default();
            if sum.take(at, slot, &[bodies], has_curves) {
                found.get_or_insert(slot.name.clone());
            }
        }
        let behind = self.body.len();
        if one != other {
            let sum = self.sums.entry((behind, "number of elements".to_owned())).or_default();
            sum.add(at, &[[one as f64, other as f64]], true, false, false);
            found.get_or_insert("number of elements".to_owned());
            return found;
        }
        let size = self.kind.element_size.max(1);
        let elements: Vec<[&[u8]; 2]> = first
            .payload
            .chunks_exact(size)
            .zip(second.payload.chunks_exact(size))
            .map(|(a, b)| [a, b])
            .collect();
        for (place, slot) in self.element.iter().enumerate() {
            let sum = self.sums.entry((behind + 1 + place, slot.name.clone())).or_default();
            if sum.take(at, slot, &elements, has_curves) {
                found.get_or_insert(slot.name.clone());
            }
        }
        found
    }

    /// The metrics of both samples by their names.
    fn metrics(&mut self, at: u64, first: Pieces<'_>, second: Pieces<'_>) -> Option<String> {
        let named = |pieces: Pieces<'_>| -> Vec<(String, f64)> {
            let view = pieces.view::<Diagnostics>();
            view.map(|v| v.elements.iter().map(|m| (m.name().to_owned(), m.value)).collect())
                .unwrap_or_default()
        };
        let (one, other) = (named(first), named(second));
        let mut found = None;
        for (place, (name, value)) in one.iter().enumerate() {
            let partner = other.iter().find(|(n, _)| n == name).map_or(f64::NAN, |(_, value)| *value);
            let sum = self.sums.entry((place, name.clone())).or_default();
            if sum.add(at, &[[*value, partner]], value.to_bits() != partner.to_bits(), false, true) {
                found.get_or_insert(name.clone());
            }
        }
        for (name, value) in other.iter().filter(|(name, _)| one.iter().all(|(n, _)| n != name)) {
            let sum = self.sums.entry((one.len(), name.clone())).or_default();
            if sum.add(at, &[[f64::NAN, *value]], true, false, true) {
                found.get_or_insert(name.clone());
            }
        }
        found
    }

    /// The fields that differ, and the curves of those that are numbers.
    pub fn finish(self) -> (Vec<FieldDifference>, Vec<Curves>) {
        let (mut fields, mut curves) = (Vec::new(), Vec::new());
        for ((_, name), sum) in self.sums {
            let Some(since) = sum.since else { continue };
            let is_number = !sum.is_code && sum.worst.is_some();
            fields.push(FieldDifference {
                field: name.clone(),
                unit: sum.unit.clone(),
                samples: sum.samples,
                rms: is_number.then(|| (sum.squares / sum.values.max(1) as f64).sqrt()),
                worst: sum.worst.filter(|_| is_number).map(|(worst, _)| worst),
                worst_s: sum.worst.filter(|_| is_number).map(|(_, at)| at as f64 * 1e-9),
                since_s: since as f64 * 1e-9,
                unknown: sum.unknown,
                trend: if is_number { trend(sum.course.items()) } else { None },
            });
            if let Some(curve) = sum.curve.filter(|_| is_number) {
                let points = curve.items().iter().map(|(at, both)| (*at as f64 * 1e-9, *both)).collect();
                curves.push(Curves { field: name, unit: sum.unit, points });
            }
        }
        (fields, curves)
    }
}

impl Sum {
    /// Takes the values of a slot in all elements. Says whether they differ.
    fn take(&mut self, at: u64, slot: &Slot, elements: &[[&[u8]; 2]], has_curve: bool) -> bool {
        if self.unit.is_empty() {
            self.unit.clone_from(&slot.unit);
        }
        let size = slot.primitive.size();
        let values: Vec<[f64; 2]> = elements
            .iter()
            .flat_map(|both| {
                (0..slot.count).filter_map(move |i| {
                    let from = slot.at + i * size;
                    let number = |bytes: &[u8]| Some(slot.primitive.as_f64(bytes.get(from..from + size)?));
                    Some([number(both[0])?, number(both[1])?])
                })
            })
            .collect();
        let own = slot.at..slot.at + slot.count * size;
        let is_other = |both: &[&[u8]; 2]| both[0].get(own.clone()) != both[1].get(own.clone());
        let differs = elements.iter().any(is_other);
        self.add(at, &values, differs, slot.is_code, has_curve && slot.count == 1 && !slot.is_code)
    }

    fn add(&mut self, at: u64, values: &[[f64; 2]], differs: bool, is_code: bool, has_curve: bool) -> bool {
        self.is_code = is_code;
        if has_curve && let Some(both) = values.first() {
            self.curve.get_or_insert_with(|| Thinned::with_room(MOST_POINTS)).push((at, *both));
        }
        if !differs && self.since.is_none() {
            return false;
        }
        if differs {
            self.samples += 1;
            self.since.get_or_insert(at);
        }
        let mut squares = 0.0;
        for [a, b] in values {
            let difference = b - a;
            if a.is_nan() && b.is_nan() {
                continue;
            }
            if !difference.is_finite() {
                self.unknown += u64::from(a.to_bits() != b.to_bits());
                continue;
            }
            squares += difference * difference;
            if difference != 0.0 && self.worst.is_none_or(|(worst, _)| difference.abs() > worst.abs()) {
                self.worst = Some((difference, at));
            }
        }
        self.values += values.len() as u64;
        self.squares += squares;
        self.course.push((at, squares));
        differs
    }
}

/// How squares of differences go on.
fn trend(course: &[(u64, f64)]) -> Option<Trend> {
    let quarter = course.len() / 4;
    if quarter < 2 {
        return None;
    }
    let rms =
        |part: &[(u64, f64)]| (part.iter().map(|(_, square)| square).sum::<f64>() / part.len() as f64).sqrt();
    let (first, last) = (rms(&course[..quarter]), rms(&course[course.len() - quarter..]));
    Some(if last >= 2.0 * first {
        Trend::Grows
    } else if last <= 0.5 * first {
        Trend::Fades
    } else {
        Trend::Stays
    })
}

/// The values of fields that are compared: all but fillers and the length of the sequence.
fn slots(fields: &[Field]) -> Vec<Slot> {
    let (mut slots, mut at) = (Vec::new(), 0);
    for field in fields {
        let start = at;
        at += field.size();
        if field.name == "reserved" || field.name == "length" {
            continue;
        }
        let is_text = field.array > 0 && field.primitive == Primitive::U8;
        let is_code = is_text || matches!(field.names, Names::Codes(_) | Names::Bits(_) | Names::Each(_));
        let slot = |name: String, unit: &str, at: usize, count: usize| Slot {
            name,
            unit: unit.to_owned(),
            at,
            count,
            primitive: field.primitive,
            is_code,
        };
        if field.array == 0 || is_text || field.array > MOST_PARTS {
            slots.push(slot(field.name.to_owned(), field.unit, start, field.array.max(1)));
            continue;
        }
        for index in 0..field.array {
            let name = match field.names {
                Names::Parts(parts) => parts.get(index).map(|part| format!("{}.{}", field.name, part.word)),
                _ => None,
            };
            let name = name.unwrap_or_else(|| format!("{}[{index}]", field.name));
            slots.push(slot(name, unit_of(field, index), start + index * field.primitive.size(), 1));
        }
    }
    slots
}

/// The unit of one value of an array: six channels of a pose have two, of the coordinates and of the angles.
fn unit_of(field: &Field, index: usize) -> &'static str {
    match field.unit.split_once(", ") {
        Some((first, second)) if field.array == 6 && !second.contains(',') => {
            if index < 3 {
                first
            } else {
                second
            }
        }
        _ => field.unit,
    }
}
