//! The contents of a page: sections of blocks, independent of their appearance.

use serde::Serialize;
use serde_json::{Value, json};

use crate::ReportError;
use crate::chart::Chart;

/// A section of the page.
#[derive(Debug)]
pub struct Section {
    /// Its name in links and in JSON.
    pub id: &'static str,
    pub title: &'static str,
    figures: Value,
    /// The blocks, from top to bottom.
    pub blocks: Vec<Block>,
    /// Why there is nothing to show, if so.
    pub missing: Option<String>,
}

/// A piece of a section.
#[derive(Debug)]
pub enum Block {
    /// A heading within the section.
    Heading(String),
    Text(String),
    Warning(String),
    /// A few important numbers.
    Tiles(Vec<Tile>),
    Table(Table),
    /// A chart with its caption.
    Chart(Chart, String),
    Picture(Picture),
    /// An SVG document with its caption.
    Drawing(String, String),
    /// Drawings of which one is seen at a time; the reader chooses it.
    Stack {
        title: String,
        /// SVG documents with their captions.
        drawings: Vec<(String, String)>,
        /// The drawing that is seen first, and alone on paper.
        first: usize,
    },
    /// A long text that the reader can open.
    Listing {
        /// Title of the part.
        title: String,
        text: String,
    },
}

#[derive(Debug)]
pub struct Tile {
    /// Name of the figure.
    pub name: String,
    /// The number with its unit.
    pub value: String,
    pub mood: Mood,
}

/// The judgement of a word or a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mood {
    Plain,
    Good,
    Bad,
}

/// A table: a heading for each column, and rows of as many cells.
#[derive(Debug, Default)]
pub struct Table {
    pub caption: String,
    /// Headings, with units.
    pub columns: Vec<String>,
    pub rows: Vec<Vec<Cell>>,
}

/// A cell of a table.
#[derive(Debug)]
pub enum Cell {
    /// Words, from the left.
    Text(String),
    /// A number, from the right.
    Number(String),
    /// A number with a bar, whose length is from 0 to 1.
    Bar(f64, String),
    /// Words with a judgement.
    State(Mood, String),
    /// A small line over time.
    Spark(Vec<(f64, f64)>),
}

#[derive(Debug)]
pub struct Picture {
    pub png: Vec<u8>,
    /// Pixels in a row, and rows.
    pub size: [u32; 2],
    pub alt: String,
    pub caption: String,
}

impl Section {
    /// A section without blocks.
    ///
    /// # Errors
    /// The figures cannot be written as JSON.
    pub fn new(id: &'static str, title: &'static str, figures: &impl Serialize) -> Result<Self, ReportError> {
        let figures = serde_json::to_value(figures).map_err(ReportError::Figures)?;
        Ok(Self { id, title, figures, blocks: Vec::new(), missing: None })
    }

    /// The section with a further block.
    pub fn with(mut self, block: Block) -> Self {
        self.blocks.push(block);
        self
    }

    /// The section without blocks, and the reason.
    pub fn nothing(mut self, why: &str) -> Self {
        self.missing = Some(why.to_owned());
        self
    }

    /// The section as JSON: its figures, and the points of its charts.
    pub fn to_json(&self) -> Value {
        let charts = self.blocks.iter().filter_map(|block| match block {
            Block::Chart(chart, _) => Some(json!(chart)),
            _ => None,
        });
        let charts: Vec<_> = charts.collect();
        json!({ "title": self.title, "missing": self.missing, "figures": self.figures, "charts": charts })
    }
}

impl Table {
    /// A table without rows.
    pub fn new(caption: impl Into<String>, columns: &[&str]) -> Self {
        let columns = columns.iter().map(ToString::to_string).collect();
        Self { caption: caption.into(), columns, rows: Vec::new() }
    }

    pub fn row(&mut self, cells: impl IntoIterator<Item = Cell>) {
        self.rows.push(cells.into_iter().collect());
    }
}

impl Cell {
    /// A paragraph of text.
    pub fn text(words: impl Into<String>) -> Self {
        Self::Text(words.into())
    }

    pub fn number(text: impl Into<String>) -> Self {
        Self::Number(text.into())
    }

    /// A count that should be 0.
    pub fn fault(count: u64) -> Self {
        let text = crate::numbers::count(count);
        if count == 0 { Self::Number(text) } else { Self::State(Mood::Bad, text) }
    }
}

impl Tile {
    /// A number that is neither good nor bad.
    pub fn plain(name: &str, value: impl Into<String>) -> Self {
        Self { name: name.to_owned(), value: value.into(), mood: Mood::Plain }
    }

    /// A word with a judgement.
    pub fn state(name: &str, value: impl Into<String>, good: bool) -> Self {
        let mood = if good { Mood::Good } else { Mood::Bad };
        Self { name: name.to_owned(), value: value.into(), mood }
    }
}
