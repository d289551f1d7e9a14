//! Topics as tables of comma-separated values.

use std::collections::BTreeMap;
use std::io::{BufWriter, Write};
use std::path::Path;

use stillpoint_recorder::Session;
use stillpoint_samples::{Diagnostics, Field, HEADER_SIZE, Pieces, Primitive, Sample, SampleKind, Shape};

use super::{Chosen, Written};
use crate::exit::Failure;
use crate::number::{Number, parts_of, single_unit};
use crate::path::ValuePath;
use crate::private;
use crate::show;

/// Topics whose samples have one set of numbers are exported where none is named.
pub fn is_default(kind: &SampleKind) -> bool {
    kind.shape == Shape::Fixed || *kind == *Diagnostics::KIND
}

/// How the samples of a topic become lines.
enum Columns {
    /// One line a sample with the values behind these paths.
    Paths(Vec<ValuePath>),
    /// One line a sample with the metrics of these names.
    Metrics(Vec<String>),
    /// One line an element with all fields.
    Fields,
}

/// Writes a table for each topic into a folder.
pub fn write(
    session: &Session,
    chosen: &Chosen,
    fields: &[String],
    out: &Path,
) -> Result<Vec<Written>, Failure> {
    let names = metric_names(session, chosen)?;
    let mut tables = BTreeMap::new();
    for (number, topic) in session.topics().iter().enumerate().filter(|(number, _)| chosen.topics[*number]) {
        let Some(kind) = topic.kind.kind() else { continue };
        let columns = if !fields.is_empty() {
            let paths = fields.iter().map(|text| ValuePath::new(text, kind)).collect::<Result<_, _>>();
            Columns::Paths(paths.map_err(Failure::wrong)?)
        } else if *kind == *Diagnostics::KIND {
            Columns::Metrics(names.get(&number).cloned().unwrap_or_default())
        } else {
            Columns::Fields
        };
        let file = out.join(format!("{}.csv", topic.name.replace(['/', '\\'], "_")));
        let failed = |e: std::io::Error| Failure::failed(format!("{}: {e}", file.display()));
        let mut table = BufWriter::new(private::create(&file).map_err(failed)?);
        writeln!(table, "{}", head(kind, &columns)).map_err(failed)?;
        let written = Written { file: file.clone(), topic: topic.name.clone(), samples: 0, lines: 0 };
        tables.insert(number, (kind, columns, table, written));
    }
    for recorded in session.samples() {
        let recorded = recorded.map_err(Failure::failed)?;
        let Some((kind, columns, table, written)) = tables.get_mut(&recorded.topic) else { continue };
        let pieces = Pieces::split(kind, &recorded.sample).map_err(Failure::failed)?;
        if !chosen.is_in_time(pieces.header().stamp) {
            continue;
        }
        written.samples += 1;
        for line in lines(kind, columns, pieces) {
            writeln!(table, "{line}")
                .map_err(|e| Failure::failed(format!("{}: {e}", written.file.display())))?;
            written.lines += 1;
        }
    }
    let mut all = Vec::new();
    for (_, (_, _, mut table, written)) in tables {
        table.flush().map_err(|e| Failure::failed(format!("{}: {e}", written.file.display())))?;
        all.push(written);
    }
    Ok(all)
}

/// The names of the metrics of each topic of diagnostics, in the order in which they come first.
fn metric_names(session: &Session, chosen: &Chosen) -> Result<BTreeMap<usize, Vec<String>>, Failure> {
    let mut names: BTreeMap<usize, Vec<String>> = BTreeMap::new();
    for recorded in session.samples_where(|t| t.kind.kind().is_some_and(|kind| *kind == *Diagnostics::KIND)) {
        let recorded = recorded.map_err(Failure::failed)?;
        if !chosen.topics[recorded.topic] {
            continue;
        }
        let pieces = Pieces::split(Diagnostics::KIND, &recorded.sample).map_err(Failure::failed)?;
        let view = pieces.view::<Diagnostics>().map_err(Failure::failed)?;
        let known = names.entry(recorded.topic).or_default();
        for metric in view.elements {
            if known.iter().all(|name| name != metric.name()) {
                known.push(metric.name().to_owned());
            }
        }
    }
    Ok(names)
}

const LEAD: &str = "incarnation,sequence,stamp_ns,origin_ns";

fn head(kind: &'static SampleKind, columns: &Columns) -> String {
    let rest: Vec<String> = match columns {
        Columns::Paths(paths) => paths.iter().map(ToString::to_string).collect(),
        Columns::Metrics(names) => names.clone(),
        Columns::Fields => {
            let element = if kind.shape == Shape::Slice { vec!["element".to_owned()] } else { Vec::new() };
            let bare = kind.bare.map(|_| "data".to_owned());
            let named = |fields| named(fields).into_iter();
            named(kind.body).chain(element).chain(bare).chain(named(kind.element)).collect()
        }
    };
    std::iter::once(LEAD.to_owned()).chain(rest.iter().map(|name| cell(name))).collect::<Vec<_>>().join(",")
}

/// The columns of fields: each value of an array has its own. A text is one cell.
fn named(fields: &[Field]) -> Vec<String> {
    let mut names = Vec::new();
    for field in fields.iter().filter(|field| is_exported(field)) {
        // Of a field that names several units, none is this column's for sure.
        let unit = |unit: &str| match unit.is_empty() || unit.contains(',') {
            true => String::new(),
            false => format!(" [{unit}]"),
        };
        if field.array == 0 || is_text(field) {
            names.push(format!("{}{}", field.name, unit(field.unit)));
            continue;
        }
        for index in 0..field.array {
            let part =
                parts_of(field).get(index).map_or_else(|| format!("[{index}]"), |p| format!(".{}", p.word));
            names.push(format!("{}{part}{}", field.name, unit(single_unit(field, index))));
        }
    }
    names
}

fn is_exported(field: &Field) -> bool {
    field.name != "reserved" && field.name != "length"
}

fn is_text(field: &Field) -> bool {
    field.array > 0 && field.primitive == Primitive::U8
}

fn lines(kind: &'static SampleKind, columns: &Columns, pieces: Pieces<'_>) -> Vec<String> {
    let header = pieces.header();
    let lead = format!("{},{},{},{}", header.incarnation, header.sequence, header.stamp, header.origin);
    let line = |cells: Vec<String>| std::iter::once(lead.clone()).chain(cells).collect::<Vec<_>>().join(",");
    match columns {
        Columns::Paths(paths) => {
            let cells = paths.iter().map(|path| match path.find(kind, pieces) {
                Some(found) => found.values.iter().map(|n| text(*n)).collect::<Vec<_>>().join(" "),
                None => String::new(),
            });
            vec![line(cells.collect())]
        }
        Columns::Metrics(names) => {
            let Ok(view) = pieces.view::<Diagnostics>() else { return Vec::new() };
            let value = |name: &String| view.elements.iter().find(|m| m.name() == name).map(|m| m.value);
            let cell = |name| value(name).map_or_else(String::new, |value| text(Number::Float(value)));
            vec![line(names.iter().map(cell).collect())]
        }
        Columns::Fields => {
            let body = cells(kind.body, pieces.meta.get(HEADER_SIZE..).unwrap_or(&[]));
            let elements = pieces.payload.chunks_exact(kind.element_size.max(1));
            let of_element = |(number, bytes): (usize, &[u8])| {
                let number = (kind.shape == Shape::Slice).then(|| number.to_string());
                let values = match kind.bare {
                    Some(primitive) => vec![text(Number::of(primitive, bytes))],
                    None => cells(kind.element, bytes),
                };
                line(body.iter().cloned().chain(number).chain(values).collect())
            };
            elements.enumerate().map(of_element).collect()
        }
    }
}

fn cells(fields: &[Field], bytes: &[u8]) -> Vec<String> {
    let (mut cells, mut at) = (Vec::new(), 0);
    for field in fields {
        let own = bytes.get(at..at + field.size()).unwrap_or(&[]);
        at += field.size();
        if !is_exported(field) {
            continue;
        }
        match is_text(field) {
            true => cells.push(cell(&show::text(own).map_or_else(|| hexadecimal(own), str::to_owned))),
            false => cells.extend(Number::all(field, own).into_iter().map(text)),
        }
    }
    cells
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A number without loss.
fn text(number: Number) -> String {
    match number {
        Number::Unsigned(x) => x.to_string(),
        Number::Signed(x) => x.to_string(),
        Number::Float(x) => format!("{x:?}"),
    }
}

/// A text as one cell. One that a table program would take for a formula is not one.
fn cell(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || " ._-[]/%°".contains(c) || c.is_alphabetic();
    let is_formula = text.starts_with(['=', '+', '-', '@', '\t']);
    if text.chars().all(plain) && !is_formula {
        return text.to_owned();
    }
    let lead = if is_formula { "'" } else { "" };
    format!("\"{lead}{}\"", text.replace('"', "\"\""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_is_one_cell_and_no_formula() {
        assert_eq!(cell("position.z [m]"), "position.z [m]");
        assert_eq!(cell("a,\"b\""), "\"a,\"\"b\"\"\"");
        assert_eq!(cell("=cmd()"), "\"'=cmd()\"");
        assert_eq!(cell("two\nlines"), "\"two\nlines\"");
    }

    #[test]
    fn numbers_keep_their_bits() {
        for x in [0.1 + 0.2, 5e-324, -0.0, f64::MAX] {
            assert_eq!(text(Number::Float(x)).parse::<f64>().map(f64::to_bits), Ok(x.to_bits()));
        }
        assert_eq!(text(Number::Unsigned(u64::MAX)), u64::MAX.to_string());
    }
}
