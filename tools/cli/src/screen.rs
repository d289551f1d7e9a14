//! A sample as a screen of text: words of codes, units, values by name.

use stillpoint_samples::{
    Diagnostics, Field, Header, NO_BITS, Names, Pieces, Primitive, Sample, SampleKind, Shape,
};

use crate::number::{Angles, Number, in_angles, parts_of, short, single_unit};
use crate::path::ValuePath;
use crate::show::{shown, text};

/// Values of an array that are shown in one line; of a longer one, a matrix shows its diagonal.
const MOST_VALUES: usize = 16;
/// Columns of named numbers.
const COLUMNS: usize = 2;

/// A sample as a screen of text.
pub fn of_sample(topic: &str, kind: &'static SampleKind, sample: Pieces<'_>, angles: Angles) -> String {
    let cut = sample.check(kind).unwrap_or(sample);
    let mut lines = vec![head(topic, kind, cut.header())];
    lines.extend(rows(kind.body, cut.meta.get(stillpoint_samples::HEADER_SIZE..).unwrap_or(&[]), angles));
    if kind.shape == Shape::Fixed {
        lines.extend(rows(kind.element, cut.payload, angles));
    } else if *kind == *Diagnostics::KIND {
        lines.extend(metrics(cut));
    } else {
        let all = cut.payload.chunks_exact(kind.element_size.max(1));
        let count = all.len();
        for (number, bytes) in all.take(shown(kind)).enumerate() {
            let line = match kind.bare {
                Some(primitive) => Number::of(primitive, bytes).text("", angles).0,
                None => in_a_line(kind.element, bytes, angles),
            };
            lines.push(format!("  [{number}] {line}"));
        }
        if count > shown(kind) {
            lines.push(format!("  and {} more elements", count - shown(kind)));
        }
    }
    lines.join("\n")
}

/// The values behind paths, a line a sample.
pub fn of_values(
    kind: &'static SampleKind,
    sample: Pieces<'_>,
    paths: &[ValuePath],
    angles: Angles,
) -> String {
    let one = |path: &ValuePath| match path.find(kind, sample) {
        None => format!("{path}: -"),
        Some(found) => match found.field {
            Some(field) if found.is_array => {
                format!("{path}: {}", array(field, &found.values, angles, usize::MAX))
            }
            Some(field) => format!("{path}: {}", value(field.names, found.values[0], found.unit, angles)),
            None => format!("{path}: {}", value(Names::None, found.values[0], found.unit, angles)),
        },
    };
    paths.iter().map(one).collect::<Vec<_>>().join("   ")
}

fn head(topic: &str, kind: &SampleKind, header: Header) -> String {
    let Header { stamp, origin, sequence, incarnation, .. } = header;
    let life = if incarnation > 0 { format!(", incarnation {incarnation}") } else { String::new() };
    let age = match stamp.checked_sub(origin) {
        Some(age) if origin > 0 => format!(", {} ms after its acquisition", short(age as f64 * 1e-6)),
        _ => String::new(),
    };
    let (at, _) = Number::Unsigned(stamp).text("ns", Angles::Radians);
    format!("{topic} ({}) sample {sequence}{life} at {at} s{age}", kind.name)
}

/// A line for each field.
fn rows(fields: &[Field], bytes: &[u8], angles: Angles) -> Vec<String> {
    let width = fields.iter().map(|f| f.name.len()).max().unwrap_or(0);
    split(fields, bytes).map(|(f, own)| format!("  {:<width$}  {}", f.name, field(f, own, angles))).collect()
}

fn in_a_line(fields: &[Field], bytes: &[u8], angles: Angles) -> String {
    split(fields, bytes)
        .map(|(f, own)| format!("{}: {}", f.name, field(f, own, angles)))
        .collect::<Vec<_>>()
        .join("  ")
}

/// The fields with their bytes, without those that hold nothing for people.
fn split<'a>(fields: &'a [Field], bytes: &'a [u8]) -> impl Iterator<Item = (&'a Field, &'a [u8])> {
    let mut at = 0;
    fields.iter().filter_map(move |field| {
        let own = bytes.get(at..at + field.size())?;
        at += field.size();
        (!["reserved", "length"].contains(&field.name)).then_some((field, own))
    })
}

fn field(field: &Field, bytes: &[u8], angles: Angles) -> String {
    match (field.array, field.primitive) {
        (0, primitive) => value(field.names, Number::of(primitive, bytes), field.unit, angles),
        (_, Primitive::U8) if text(bytes).is_some() => text(bytes).unwrap_or_default().to_owned(),
        _ => array(field, &Number::all(field, bytes), angles, MOST_VALUES),
    }
}

/// One value in words, or with its unit.
fn value(names: Names, number: Number, unit: &str, angles: Angles) -> String {
    if let Number::Unsigned(code) = number
        && let Some(words) = names.text(code)
    {
        return words;
    }
    let (text, unit) = number.text(unit, angles);
    if unit.is_empty() || !number.float().is_finite() { text } else { format!("{text} {unit}") }
}

fn array(field: &Field, values: &[Number], angles: Angles, most: usize) -> String {
    let parts = parts_of(field);
    if !parts.is_empty() {
        let one = |(i, number): (usize, &Number)| {
            let (text, unit) = number.text(single_unit(field, i), angles);
            let name = parts.get(i).map_or("", |part| part.word);
            (format!("{name} {text}"), unit)
        };
        let all: Vec<(String, String)> = values.iter().enumerate().map(one).collect();
        let is_one_unit = all.iter().all(|(_, unit)| *unit == all[0].1);
        let message = all.iter().map(|(text, unit)| {
            if is_one_unit || unit.is_empty() { text.clone() } else { format!("{text} {unit}") }
        });
        let message = message.collect::<Vec<_>>().join("  ");
        return if is_one_unit { format!("{message} {}", all[0].1).trim_end().to_owned() } else { message };
    }
    let (scale, unit) = in_angles(field.unit, angles);
    let one = |number: &Number| match number {
        Number::Float(x) => short(x * scale),
        other => other.text("", angles).0,
    };
    let join = |numbers: &[Number]| numbers.iter().map(one).collect::<Vec<_>>().join("  ");
    let message = match field.names {
        Names::Rows(rows, columns) if values.len() > most && rows == columns => {
            let diagonal: Vec<Number> =
                (0..rows).filter_map(|i| values.get(i * (columns + 1)).copied()).collect();
            format!("{rows} by {columns}, diagonal: {}", join(&diagonal))
        }
        Names::Rows(rows, columns) if values.len() > most => {
            return format!("{rows} by {columns} (`echo TOPIC {}[0][0]` shows a value)", field.name);
        }
        Names::Rows(_, columns) if most == usize::MAX => {
            values.chunks(columns).map(|row| format!("\n  {}", join(row))).collect()
        }
        // Room that is not used ends an array of eight bladders.
        _ => {
            let used = values.iter().rposition(|n| n.float() != 0.0).map_or(0, |last| last + 1);
            let shown = &values[..used.min(most)];
            match (shown.len(), used - shown.len(), values.len() - used) {
                (0, ..) => return format!("{} zeros", values.len()),
                (_, 0, 0) => join(shown),
                (_, 0, zeros) => format!("{}  and {zeros} zeros", join(shown)),
                (_, more, _) => format!("{}  and {more} more", join(shown)),
            }
        }
    };
    if unit.is_empty() || unit.contains(',') { message } else { format!("{message} {unit}") }
}

/// The named numbers of diagnostics, in columns.
fn metrics(sample: Pieces<'_>) -> Vec<String> {
    let Ok(view) = sample.view::<Diagnostics>() else { return Vec::new() };
    if view.elements.is_empty() {
        return vec![format!("  {NO_BITS}")];
    }
    let all: Vec<String> =
        view.elements.iter().map(|m| format!("{:<24} {:<12}", m.name(), short(m.value))).collect();
    let height = all.len().div_ceil(COLUMNS);
    let line = |row: usize| {
        let cells: Vec<&str> = all.iter().skip(row).step_by(height).map(String::as_str).collect();
        format!("  {}", cells.join("  ")).trim_end().to_owned()
    };
    (0..height).map(line).collect()
}

#[cfg(test)]
mod tests {
    use stillpoint_samples::{AlignedBytes, Gate, GateElement, GateReason, HEADER_SIZE};
    use zerocopy::IntoBytes;

    use super::*;

    #[test]
    fn a_gate_is_shown_in_words_with_units_and_in_degrees() {
        let gate = GateElement {
            position_error: [0.001, -0.002, f64::NAN],
            angle_error: [0.0, std::f64::consts::PI, 0.0],
            position_sd: 0.0005,
            angle_sd: 0.1,
            lease_ends: 0,
            well_for: 1_500_000_000,
            on_for: 0,
            watched_for: 0,
            leases: 3,
            datagram: 9,
            beam: 0,
            reasons: GateReason::POSE_STALE | GateReason::POSITION,
            ended_by: 0,
            reserved: 0,
        };
        let mut bytes = AlignedBytes::zeroed(Gate::KIND.total_size(1).unwrap_or(0));
        bytes[28] = 1;
        bytes[HEADER_SIZE..].copy_from_slice(gate.as_bytes());
        let sample = Pieces::split(Gate::KIND, &bytes).unwrap_or_else(|e| panic!("{e}"));
        let shown = of_sample("gate.state", Gate::KIND, sample, Angles::Degrees);
        for line in [
            "  position_error  x 0.001  y -0.002  z NaN m",
            "  angle_error     pitch 0  roll 180  yaw 0 deg",
            "  well_for        1.500000000 s",
            "  beam            off",
            "  reasons         pose stale, position",
            "  ended_by        none",
        ] {
            assert!(shown.lines().any(|l| l == line), "{line:?} is not in\n{shown}");
        }
        assert!(!shown.contains("reserved"));
        let paths = ["reasons", "position_error.y"]
            .map(|p| ValuePath::new(p, Gate::KIND).unwrap_or_else(|e| panic!("{e}")));
        let line = of_values(Gate::KIND, sample, &paths, Angles::Radians);
        assert_eq!(line, "reasons: pose stale, position   position_error.y: -0.002 m");
    }
}
