//! A table as comma-separated values.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

use super::table::{Cell, Column, Rows};
use crate::exit::Failure;
use crate::number::Number;
use crate::private;

/// A file of comma-separated values.
pub struct Csv {
    file: PathBuf,
    writer: BufWriter<File>,
}

impl Csv {
    /// Opens the file and writes the line with the names of the columns.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn create(file: PathBuf, columns: &[Column]) -> Result<Self, Failure> {
        let created = private::create(&file).map_err(|e| failed(&file, &e))?;
        let mut csv = Self { writer: BufWriter::new(created), file };
        csv.line(columns.iter().map(|column| cell(&column.heading)))?;
        Ok(csv)
    }

    fn line(&mut self, cells: impl Iterator<Item = String>) -> Result<(), Failure> {
        let line = cells.collect::<Vec<_>>().join(",");
        writeln!(self.writer, "{line}").map_err(|e| failed(&self.file, &e))
    }
}

impl Rows for Csv {
    fn row(&mut self, cells: Vec<Cell>) -> Result<(), Failure> {
        self.line(cells.iter().map(|value| match value {
            Cell::Number(number) => text(*number),
            Cell::Numbers(numbers) => numbers.iter().map(|n| text(*n)).collect::<Vec<_>>().join(" "),
            Cell::Text(text) => cell(text),
            Cell::Missing => String::new(),
        }))
    }

    fn finish(mut self: Box<Self>) -> Result<(), Failure> {
        self.writer.flush().map_err(|e| failed(&self.file, &e))
    }
}

fn failed(file: &std::path::Path, error: &std::io::Error) -> Failure {
    Failure::failed(format!("{}: {error}", file.display()))
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
