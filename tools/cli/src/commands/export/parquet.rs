//! A table as a file of Apache Parquet. Its columns have the types of the fields, and their units and codes as metadata
//! of the schema of Arrow, which readers such as pyarrow and pandas show.

use std::collections::HashMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::types::{
    ArrowPrimitiveType, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, UInt8Type,
    UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{ArrayRef, ListArray, PrimitiveArray, RecordBatch, StringArray};
use arrow_schema::{DataType, Field, Schema, SchemaRef};
use parquet::arrow::ArrowWriter;
use parquet::basic::Compression;
use parquet::file::properties::WriterProperties;
use serde_json::{Map, Value};
use stillpoint_recorder::Topic;
use stillpoint_samples::{Code, Names, Primitive};

use super::table::{Cell, Column, Content, Rows};
use crate::exit::Failure;
use crate::number::Number;
use crate::private;

/// Rows that are collected before they are written: a few megabytes.
const BATCH: usize = 16 * 1024;

/// A file of Parquet.
pub struct Parquet {
    file: PathBuf,
    writer: ArrowWriter<File>,
    schema: SchemaRef,
    contents: Vec<Content>,
    /// The rows that are not written yet, by column.
    pending: Vec<Vec<Cell>>,
}

impl Parquet {
    /// Opens the file for a topic.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn create(file: PathBuf, topic: &Topic, columns: &[Column]) -> Result<Self, Failure> {
        let created = private::create(&file).map_err(|e| failed(&file, &e))?;
        let schema: SchemaRef = Arc::new(schema(topic, columns));
        // Without the version of the library, the same session gives the same bytes for longer.
        let properties = WriterProperties::builder()
            .set_created_by(concat!("stillpoint ", env!("CARGO_PKG_VERSION")).to_owned())
            .set_compression(Compression::ZSTD(Default::default()))
            .build();
        let writer = ArrowWriter::try_new(created, schema.clone(), Some(properties));
        let writer = writer.map_err(|e| failed(&file, &e))?;
        let contents = columns.iter().map(|column| column.content).collect();
        Ok(Self { file, writer, schema, contents, pending: vec![Vec::new(); columns.len()] })
    }

    fn write_pending(&mut self) -> Result<(), Failure> {
        let arrays = self.contents.iter().zip(&mut self.pending).map(|(content, cells)| {
            let array = array(*content, cells);
            cells.clear();
            array
        });
        let batch = RecordBatch::try_new(self.schema.clone(), arrays.collect());
        let batch = batch.map_err(|e| failed(&self.file, &e))?;
        self.writer.write(&batch).map_err(|e| failed(&self.file, &e))
    }
}

impl Rows for Parquet {
    fn row(&mut self, cells: Vec<Cell>) -> Result<(), Failure> {
        for (column, cell) in self.pending.iter_mut().zip(cells) {
            column.push(cell);
        }
        let is_full = self.pending.first().is_some_and(|column| column.len() >= BATCH);
        if is_full { self.write_pending() } else { Ok(()) }
    }

    fn finish(mut self: Box<Self>) -> Result<(), Failure> {
        self.write_pending()?;
        self.writer.close().map(drop).map_err(|e| failed(&self.file, &e))
    }
}

fn failed(file: &Path, error: &impl std::fmt::Display) -> Failure {
    Failure::failed(format!("{}: {error}", file.display()))
}

/// The schema of a table: the topic on the whole, unit and names on each column.
fn schema(topic: &Topic, columns: &[Column]) -> Schema {
    let fields = columns.iter().map(|column| {
        let field = Field::new(&column.name, data_type(column.content), true);
        field.with_metadata(metadata(column))
    });
    let about = [("topic", &topic.name), ("operator", &topic.operator), ("type", &topic.type_name)];
    let frame = topic.frame.iter().map(|frame| ("frame", frame));
    let about = about.into_iter().chain(frame).filter(|(_, value)| !value.is_empty());
    let about: HashMap<String, String> =
        about.map(|(name, value)| (name.to_owned(), value.clone())).collect();
    Schema::new_with_metadata(fields.collect::<Vec<_>>(), about)
}

/// `unit`; `codes` or `bits`, a JSON object from number to word; `each_bit`, what a bit stands for.
fn metadata(column: &Column) -> HashMap<String, String> {
    let words = |codes: &[Code]| {
        let entry = |code: &Code| (code.value.to_string(), Value::from(code.word));
        Value::Object(codes.iter().map(entry).collect::<Map<_, _>>()).to_string()
    };
    let names = match column.names {
        Names::Codes(codes) => Some(("codes", words(codes))),
        Names::Bits(bits) => Some(("bits", words(bits))),
        Names::Each(part) => Some(("each_bit", part.to_owned())),
        // The names of columns have them.
        Names::Parts(_) | Names::Rows(..) | Names::None => None,
    };
    let unit = (!column.unit.is_empty()).then(|| ("unit", column.unit.clone()));
    unit.into_iter().chain(names).map(|(name, value)| (name.to_owned(), value)).collect()
}

fn data_type(content: Content) -> DataType {
    match content {
        Content::Number(primitive) => number_type(primitive),
        Content::Numbers(primitive) => DataType::new_list(number_type(primitive), true),
        Content::Text => DataType::Utf8,
    }
}

fn number_type(primitive: Primitive) -> DataType {
    match primitive {
        Primitive::U8 => DataType::UInt8,
        Primitive::I8 => DataType::Int8,
        Primitive::U16 => DataType::UInt16,
        Primitive::I16 => DataType::Int16,
        Primitive::U32 => DataType::UInt32,
        Primitive::I32 => DataType::Int32,
        Primitive::U64 => DataType::UInt64,
        Primitive::I64 => DataType::Int64,
        Primitive::F32 => DataType::Float32,
        Primitive::F64 => DataType::Float64,
    }
}

fn array(content: Content, cells: &[Cell]) -> ArrayRef {
    match content {
        Content::Text => {
            let text = |cell: &Cell| match cell {
                Cell::Text(text) => Some(text.clone()),
                _ => None,
            };
            Arc::new(cells.iter().map(text).collect::<StringArray>())
        }
        Content::Number(primitive) => match primitive {
            Primitive::U8 => numbers::<UInt8Type>(cells, |n| unsigned(n) as u8),
            Primitive::I8 => numbers::<Int8Type>(cells, |n| signed(n) as i8),
            Primitive::U16 => numbers::<UInt16Type>(cells, |n| unsigned(n) as u16),
            Primitive::I16 => numbers::<Int16Type>(cells, |n| signed(n) as i16),
            Primitive::U32 => numbers::<UInt32Type>(cells, |n| unsigned(n) as u32),
            Primitive::I32 => numbers::<Int32Type>(cells, |n| signed(n) as i32),
            Primitive::U64 => numbers::<UInt64Type>(cells, unsigned),
            Primitive::I64 => numbers::<Int64Type>(cells, signed),
            Primitive::F32 => numbers::<Float32Type>(cells, |n| n.float() as f32),
            Primitive::F64 => numbers::<Float64Type>(cells, Number::float),
        },
        Content::Numbers(primitive) => match primitive {
            Primitive::U8 => lists::<UInt8Type>(cells, |n| unsigned(n) as u8),
            Primitive::I8 => lists::<Int8Type>(cells, |n| signed(n) as i8),
            Primitive::U16 => lists::<UInt16Type>(cells, |n| unsigned(n) as u16),
            Primitive::I16 => lists::<Int16Type>(cells, |n| signed(n) as i16),
            Primitive::U32 => lists::<UInt32Type>(cells, |n| unsigned(n) as u32),
            Primitive::I32 => lists::<Int32Type>(cells, |n| signed(n) as i32),
            Primitive::U64 => lists::<UInt64Type>(cells, unsigned),
            Primitive::I64 => lists::<Int64Type>(cells, signed),
            Primitive::F32 => lists::<Float32Type>(cells, |n| n.float() as f32),
            Primitive::F64 => lists::<Float64Type>(cells, Number::float),
        },
    }
}

fn numbers<T: ArrowPrimitiveType>(cells: &[Cell], value: impl Fn(Number) -> T::Native) -> ArrayRef {
    let of = |cell: &Cell| match cell {
        Cell::Number(number) => Some(value(*number)),
        _ => None,
    };
    Arc::new(PrimitiveArray::<T>::from_iter(cells.iter().map(of)))
}

fn lists<T: ArrowPrimitiveType>(cells: &[Cell], value: impl Fn(Number) -> T::Native) -> ArrayRef {
    let of = |cell: &Cell| match cell {
        Cell::Numbers(numbers) => Some(numbers.iter().map(|n| Some(value(*n))).collect::<Vec<_>>()),
        _ => None,
    };
    Arc::new(ListArray::from_iter_primitive::<T, _, _>(cells.iter().map(of)))
}

/// The bits of an unsigned field: its cells hold no other number.
fn unsigned(number: Number) -> u64 {
    match number {
        Number::Unsigned(x) => x,
        Number::Signed(x) => x as u64,
        Number::Float(x) => x as u64,
    }
}

fn signed(number: Number) -> i64 {
    match number {
        Number::Signed(x) => x,
        Number::Unsigned(x) => x as i64,
        Number::Float(x) => x as i64,
    }
}
