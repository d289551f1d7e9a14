//! Topics as tables: columns with their units and names of codes, and a row for each sample or for each of its elements.
//!
//! What is here knows no file format: a [`Rows`] writes the file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use stillpoint_recorder::{Session, Topic};
use stillpoint_samples::{
    Diagnostics, Field, HEADER_SIZE, Names, Pieces, Primitive, Sample, SampleKind, Shape,
};

use super::{Chosen, Written};
use crate::exit::Failure;
use crate::number::{Number, parts_of, single_unit};
use crate::path::ValuePath;
use crate::show;

/// Topics whose samples have one set of numbers are exported where none is named.
pub fn is_default(kind: &SampleKind) -> bool {
    kind.shape == Shape::Fixed || *kind == *Diagnostics::KIND
}

/// A column of a table.
#[cfg_attr(not(feature = "parquet"), expect(dead_code, reason = "a table of text has names alone"))]
#[derive(Clone, Debug)]
pub struct Column {
    /// Its name, without unit.
    pub name: String,
    /// The unit of its values; empty for plain numbers.
    pub unit: String,
    /// What its cells hold.
    pub content: Content,
    /// What its numbers mean.
    pub names: Names,
    /// Its name for a person: with the unit, where the name does not say it.
    pub heading: String,
}

/// What the cells of a column hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// A number.
    Number(Primitive),
    /// All values of an array.
    Numbers(Primitive),
    /// A text.
    Text,
}

/// A value of a row.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    Number(Number),
    Numbers(Vec<Number>),
    Text(String),
    /// The sample has no such value.
    Missing,
}

/// A file that takes the rows of one table.
pub trait Rows {
    /// Writes a row: a cell for each column.
    ///
    /// # Errors
    /// The file cannot be written.
    fn row(&mut self, cells: Vec<Cell>) -> Result<(), Failure>;

    /// Writes what is left, and the end of the file.
    ///
    /// # Errors
    /// The file cannot be written.
    fn finish(self: Box<Self>) -> Result<(), Failure>;
}

/// How the samples of a topic become rows.
enum Form {
    /// A row a sample with the values behind these paths.
    Paths(Vec<ValuePath>),
    /// A row a sample with the metrics of these names.
    Metrics(Vec<String>),
    /// A row an element with all fields.
    Fields,
}

/// A table that is being written.
struct Table {
    kind: &'static SampleKind,
    form: Form,
    rows: Box<dyn Rows>,
    written: Written,
}

/// Writes a table for each topic into a folder; `create` opens the file of one, whose names end in `extension`.
///
/// # Errors
/// A path is not one of the samples, the session cannot be read, or a file cannot be written.
pub fn write(
    session: &Session,
    chosen: &Chosen,
    fields: &[String],
    out: &Path,
    extension: &str,
    create: impl Fn(PathBuf, &Topic, &[Column]) -> Result<Box<dyn Rows>, Failure>,
) -> Result<Vec<Written>, Failure> {
    let names = metric_names(session, chosen)?;
    let mut tables = BTreeMap::new();
    for (number, topic) in session.topics().iter().enumerate().filter(|(number, _)| chosen.topics[*number]) {
        let Some(kind) = topic.kind.kind() else { continue };
        let form = if !fields.is_empty() {
            let paths = fields.iter().map(|text| ValuePath::new(text, kind)).collect::<Result<_, _>>();
            Form::Paths(paths.map_err(Failure::wrong)?)
        } else if *kind == *Diagnostics::KIND {
            Form::Metrics(names.get(&number).cloned().unwrap_or_default())
        } else {
            Form::Fields
        };
        let file = out.join(format!("{}.{extension}", topic.name.replace(['/', '\\'], "_")));
        let rows = create(file.clone(), topic, &columns(kind, &form))?;
        let written = Written { file, topic: topic.name.clone(), samples: 0, lines: 0 };
        tables.insert(number, Table { kind, form, rows, written });
    }
    for recorded in session.samples() {
        let recorded = recorded.map_err(Failure::failed)?;
        let Some(table) = tables.get_mut(&recorded.topic) else { continue };
        let pieces = Pieces::split(table.kind, &recorded.sample).map_err(Failure::failed)?;
        if !chosen.is_in_time(pieces.header().stamp) {
            continue;
        }
        table.written.samples += 1;
        table.written.lines += take(table.kind, &table.form, pieces, table.rows.as_mut())?;
    }
    let end = |table: Table| table.rows.finish().map(|()| table.written);
    tables.into_values().map(end).collect()
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

/// A column whose name says enough.
fn plain(name: &str, unit: &str, content: Content, names: Names) -> Column {
    Column { name: name.to_owned(), unit: unit.to_owned(), content, names, heading: name.to_owned() }
}

/// The columns of a table: first those that every table has.
fn columns(kind: &'static SampleKind, form: &Form) -> Vec<Column> {
    let lead = |name, primitive, unit| plain(name, unit, Content::Number(primitive), Names::None);
    let mut columns = vec![
        lead("incarnation", Primitive::U32, ""),
        lead("sequence", Primitive::U64, ""),
        lead("stamp_ns", Primitive::U64, "ns"),
        lead("origin_ns", Primitive::U64, "ns"),
    ];
    match form {
        Form::Paths(paths) => columns.extend(paths.iter().map(|path| {
            let values = path.values(kind);
            let content = match values.is_array {
                true => Content::Numbers(values.primitive),
                false => Content::Number(values.primitive),
            };
            plain(&path.to_string(), values.unit, content, values.names)
        })),
        Form::Metrics(names) => {
            columns.extend(names.iter().map(|name| lead(name, Primitive::F64, "")));
        }
        Form::Fields => {
            columns.extend(named(kind.body));
            if kind.shape == Shape::Slice {
                columns.push(lead("element", Primitive::U64, ""));
            }
            columns.extend(kind.bare.map(|primitive| lead("data", primitive, "")));
            columns.extend(named(kind.element));
        }
    }
    columns
}

/// The columns of fields: each value of an array has its own. A text is one cell.
fn named(fields: &[Field]) -> Vec<Column> {
    let mut columns = Vec::new();
    let mut push = |name: String, unit: &str, field: &Field, content| {
        // Of a field that names several units, none is this column's for sure.
        let unit = if unit.contains(',') { "" } else { unit };
        let heading = if unit.is_empty() { name.clone() } else { format!("{name} [{unit}]") };
        columns.push(Column { name, unit: unit.to_owned(), content, names: field.names, heading });
    };
    for field in fields.iter().filter(|field| is_exported(field)) {
        let number = Content::Number(field.primitive);
        if field.array == 0 || is_text(field) {
            let content = if is_text(field) { Content::Text } else { number };
            push(field.name.to_owned(), field.unit, field, content);
            continue;
        }
        for index in 0..field.array {
            let part =
                parts_of(field).get(index).map_or_else(|| format!("[{index}]"), |p| format!(".{}", p.word));
            push(format!("{}{part}", field.name), single_unit(field, index), field, number);
        }
    }
    columns
}

fn is_exported(field: &Field) -> bool {
    field.name != "reserved" && field.name != "length"
}

fn is_text(field: &Field) -> bool {
    field.array > 0 && field.primitive == Primitive::U8
}

/// Writes the rows of a sample, and returns their number.
fn take(
    kind: &'static SampleKind,
    form: &Form,
    pieces: Pieces<'_>,
    rows: &mut dyn Rows,
) -> Result<u64, Failure> {
    let header = pieces.header();
    let lead = [u64::from(header.incarnation), header.sequence, header.stamp, header.origin];
    let lead = lead.map(|number| Cell::Number(Number::Unsigned(number)));
    let row = |cells: Vec<Cell>| lead.iter().cloned().chain(cells).collect();
    match form {
        Form::Paths(paths) => {
            let cell = |path: &ValuePath| match path.find(kind, pieces) {
                Some(found) if found.is_array => Cell::Numbers(found.values),
                Some(found) => found.values.first().map_or(Cell::Missing, |n| Cell::Number(*n)),
                None => Cell::Missing,
            };
            rows.row(row(paths.iter().map(cell).collect()))?;
            Ok(1)
        }
        Form::Metrics(names) => {
            let Ok(view) = pieces.view::<Diagnostics>() else { return Ok(0) };
            let value = |name: &String| view.elements.iter().find(|m| m.name() == name).map(|m| m.value);
            let cell = |name| value(name).map_or(Cell::Missing, |value| Cell::Number(Number::Float(value)));
            rows.row(row(names.iter().map(cell).collect()))?;
            Ok(1)
        }
        Form::Fields => {
            let body = cells(kind.body, pieces.meta.get(HEADER_SIZE..).unwrap_or(&[]));
            let mut count = 0;
            for bytes in pieces.payload.chunks_exact(kind.element_size.max(1)) {
                let number = Cell::Number(Number::Unsigned(count));
                let number = (kind.shape == Shape::Slice).then_some(number);
                let values = match kind.bare {
                    Some(primitive) => vec![Cell::Number(Number::of(primitive, bytes))],
                    None => cells(kind.element, bytes),
                };
                rows.row(row(body.iter().cloned().chain(number).chain(values).collect()))?;
                count += 1;
            }
            Ok(count)
        }
    }
}

fn cells(fields: &[Field], bytes: &[u8]) -> Vec<Cell> {
    let (mut cells, mut at) = (Vec::new(), 0);
    for field in fields {
        let own = bytes.get(at..at + field.size()).unwrap_or(&[]);
        at += field.size();
        if !is_exported(field) {
            continue;
        }
        match is_text(field) {
            true => cells.push(Cell::Text(show::text(own).map_or_else(|| hexadecimal(own), str::to_owned))),
            false => cells.extend(Number::all(field, own).into_iter().map(Cell::Number)),
        }
    }
    cells
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
