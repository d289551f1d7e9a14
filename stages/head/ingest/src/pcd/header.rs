//! The header of a PCD file: its fields, its shape and its encoding.

use super::PcdError;

/// How the records are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// One record a line, numbers as text.
    Ascii,
    /// Records one after another, little-endian.
    Binary,
    /// Fields one after another, little-endian, LZF-compressed.
    BinaryCompressed,
}

/// A number type of PCD: TYPE and SIZE together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum FieldType {
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
    F32,
    F64,
}

impl FieldType {
    fn new(kind: char, size: usize) -> Option<Self> {
        Some(match (kind, size) {
            ('I', 1) => Self::I8,
            ('I', 2) => Self::I16,
            ('I', 4) => Self::I32,
            ('I', 8) => Self::I64,
            ('U', 1) => Self::U8,
            ('U', 2) => Self::U16,
            ('U', 4) => Self::U32,
            ('U', 8) => Self::U64,
            ('F', 4) => Self::F32,
            ('F', 8) => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of one number.
    #[must_use]
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }
}

/// One field of a record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// Its name, for instance `x`.
    pub name: String,
    /// Its number type.
    pub kind: FieldType,
    /// Numbers in it.
    pub count: usize,
    /// Bytes of the record before it.
    pub offset: usize,
    /// Numbers of the record before it.
    pub column: usize,
}

/// A checked header: the sizes fit together and x, y and z are there.
#[derive(Debug, Clone, PartialEq)]
pub struct PcdHeader {
    /// Fields in file order.
    pub fields: Vec<Field>,
    /// Points in a row.
    pub width: usize,
    /// Rows; 1 for an unorganised cloud.
    pub height: usize,
    /// Sensor pose when the cloud was taken: translation in metres, then a unit quaternion w, x, y, z.
    pub viewpoint: [f64; 7],
    /// How the records are written.
    pub encoding: Encoding,
    /// Bytes of a binary record.
    pub record_size: usize,
    /// Numbers of a record.
    pub columns: usize,
    /// Where the data starts, in bytes.
    pub data_offset: usize,
    /// The line on which ascii data starts, from 1.
    pub data_line: usize,
    /// The places of x, y and z in `fields`.
    pub(super) axes: [usize; 3],
}

/// Header entries as they stand, each with its line.
#[derive(Default)]
struct Entries<'a>(Vec<(&'static str, usize, Vec<&'a str>)>);

const KEYS: [&str; 10] =
    ["VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA"];

impl<'a> Entries<'a> {
    fn find(&self, key: &'static str) -> Option<(usize, &[&'a str])> {
        self.0.iter().find(|(k, ..)| *k == key).map(|(_, line, values)| (*line, values.as_slice()))
    }

    fn need(&self, key: &'static str) -> Result<(usize, &[&'a str]), PcdError> {
        self.find(key).ok_or(PcdError::Missing { key })
    }

    /// As many values as there are fields.
    fn per_field(&self, key: &'static str, fields: usize) -> Result<(usize, &[&'a str]), PcdError> {
        let (line, values) = self.need(key)?;
        if values.len() != fields {
            return Err(PcdError::ValueCount { line, key, expected: fields, found: values.len() });
        }
        Ok((line, values))
    }

    fn number(&self, key: &'static str) -> Result<usize, PcdError> {
        let (line, values) = self.per_field(key, 1)?;
        parse_number(values[0], line, key)
    }
}

fn bad(line: usize, key: &'static str, expected: &'static str, found: &str) -> PcdError {
    PcdError::BadValue { line, key, expected, found: found.chars().take(32).collect() }
}

fn parse_number(text: &str, line: usize, key: &'static str) -> Result<usize, PcdError> {
    text.parse().map_err(|_| bad(line, key, "a whole number", text))
}

/// The lines up to `DATA`, with the offset and the line that follow them.
fn entries(bytes: &[u8]) -> Result<(Entries<'_>, usize, usize), PcdError> {
    let mut entries = Entries::default();
    let (mut offset, mut line) = (0, 0);
    while offset < bytes.len() {
        line += 1;
        let rest = &bytes[offset..];
        let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        offset += (length + 1).min(rest.len());
        // A comment may hold any bytes.
        let text = rest[..length].trim_ascii();
        if text.starts_with(b"#") {
            continue;
        }
        let unknown = || {
            let first = text.split(u8::is_ascii_whitespace).next().unwrap_or_default();
            PcdError::UnknownKey { line, key: String::from_utf8_lossy(first).chars().take(32).collect() }
        };
        let text = std::str::from_utf8(text).map_err(|_| unknown())?;
        let mut words = text.split_ascii_whitespace();
        let Some(first) = words.next() else { continue };
        // The name of FIELDS in files before version 0.6.
        let first = if first.eq_ignore_ascii_case("COLUMNS") { "FIELDS" } else { first };
        let Some(key) = KEYS.into_iter().find(|k| k.eq_ignore_ascii_case(first)) else {
            return Err(unknown());
        };
        if entries.find(key).is_some() {
            return Err(PcdError::Repeated { line, key });
        }
        entries.0.push((key, line, words.collect()));
        if key == "DATA" {
            return Ok((entries, offset, line + 1));
        }
    }
    Err(PcdError::NoDataLine { lines: line })
}

impl PcdHeader {
    /// Reads and checks the header at the start of `bytes`.
    ///
    /// # Errors
    /// Everything that is wrong with the header; nothing of the data is looked at.
    pub fn parse(bytes: &[u8]) -> Result<Self, PcdError> {
        let (entries, data_offset, data_line) = entries(bytes)?;
        let (width, height) = (entries.number("WIDTH")?, entries.number("HEIGHT")?);
        let points = match entries.find("POINTS") {
            Some(_) => entries.number("POINTS")?,
            None => width.checked_mul(height).ok_or(PcdError::TooLarge { points: width, columns: 0 })?,
        };
        if width.checked_mul(height) != Some(points) {
            return Err(PcdError::PointCount { width, height, points });
        }
        let (fields, record_size, columns) = fields(&entries, points)?;
        let axes = [axis(&fields, 'x')?, axis(&fields, 'y')?, axis(&fields, 'z')?];
        let (line, data) = entries.per_field("DATA", 1)?;
        let encoding = match data[0].to_ascii_lowercase().as_str() {
            "ascii" => Encoding::Ascii,
            "binary" => Encoding::Binary,
            "binary_compressed" => Encoding::BinaryCompressed,
            _ => return Err(bad(line, "DATA", "ascii, binary or binary_compressed", data[0])),
        };
        let viewpoint = viewpoint(&entries)?;
        Ok(Self {
            fields,
            width,
            height,
            viewpoint,
            encoding,
            record_size,
            columns,
            data_offset,
            data_line,
            axes,
        })
    }

    /// Points in the file.
    #[must_use]
    pub fn points(&self) -> usize {
        // Checked against overflow when the header was parsed.
        self.width * self.height
    }
}

/// The fields with their places, the bytes and the numbers of a record.
fn fields(entries: &Entries<'_>, points: usize) -> Result<(Vec<Field>, usize, usize), PcdError> {
    let (_, names) = entries.need("FIELDS")?;
    let (size_line, sizes) = entries.per_field("SIZE", names.len())?;
    let (type_line, types) = entries.per_field("TYPE", names.len())?;
    let counts = match entries.find("COUNT") {
        Some(_) => Some(entries.per_field("COUNT", names.len())?),
        None => None,
    };
    let mut fields = Vec::with_capacity(names.len());
    let (mut offset, mut column) = (0_usize, 0_usize);
    for (i, name) in names.iter().enumerate() {
        let size = parse_number(sizes[i], size_line, "SIZE")?;
        let mut letters = types[i].chars();
        let (Some(letter), None) = (letters.next(), letters.next()) else {
            return Err(bad(type_line, "TYPE", "I, U or F", types[i]));
        };
        let letter = letter.to_ascii_uppercase();
        let kind = FieldType::new(letter, size).ok_or_else(|| PcdError::FieldType {
            field: name.chars().take(32).collect(),
            kind: letter,
            size,
        })?;
        let count = counts.map_or(Ok(1), |(line, values)| parse_number(values[i], line, "COUNT"))?;
        fields.push(Field { name: (*name).to_owned(), kind, count, offset, column });
        let too_large = || PcdError::TooLarge { points, columns: count };
        offset = count.checked_mul(size).and_then(|n| n.checked_add(offset)).ok_or_else(too_large)?;
        column = column.checked_add(count).ok_or_else(too_large)?;
    }
    match offset.checked_mul(points) {
        Some(_) => Ok((fields, offset, column)),
        None => Err(PcdError::TooLarge { points, columns: column }),
    }
}

fn axis(fields: &[Field], axis: char) -> Result<usize, PcdError> {
    let named = |name: char| {
        let fits = move |f: &Field| f.count == 1 && f.name.chars().eq([name]);
        fields.iter().enumerate().filter(move |(_, f)| fits(f))
    };
    // Some programs write X; a file that has both means the lower case.
    let name = if named(axis).next().is_some() { axis } else { axis.to_ascii_uppercase() };
    let mut places = named(name);
    match (places.next(), places.count()) {
        (Some((place, _)), 0) => Ok(place),
        (first, more) => Err(PcdError::Coordinate { axis, found: usize::from(first.is_some()) + more }),
    }
}

fn viewpoint(entries: &Entries<'_>) -> Result<[f64; 7], PcdError> {
    let mut viewpoint = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
    if entries.find("VIEWPOINT").is_some() {
        let (line, values) = entries.per_field("VIEWPOINT", 7)?;
        for (slot, text) in viewpoint.iter_mut().zip(values) {
            *slot = text.parse().map_err(|_| bad(line, "VIEWPOINT", "seven numbers", text))?;
        }
    }
    Ok(viewpoint)
}
