//! `sensor_msgs/msg/PointCloud2` in CDR: a message's bytes in, points out.
//!
//! The fields `x`, `y` and `z` may be 32-bit or 64-bit floats at any offsets; other fields are skipped.

use stillpoint_cdr::{CdrError, Reader};
use thiserror::Error;

use crate::checks;

/// `datatype` of a 32-bit float.
const FLOAT32: u8 = 7;
/// `datatype` of a 64-bit float.
const FLOAT64: u8 = 8;

/// Why bytes are not a cloud. Offsets are in bytes from the message's start.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PointCloud2Error {
    /// The message is not CDR, or damaged.
    #[error("{fault} ({what})")]
    Cdr {
        /// The part of the message.
        what: &'static str,
        /// What is wrong with it.
        fault: CdrError,
    },
    /// A coordinate is absent or repeated.
    #[error("the message needs exactly one field `{axis}` and has {found}")]
    Coordinate {
        /// `x`, `y` or `z`.
        axis: char,
        /// Fields of that name.
        found: usize,
    },
    /// A coordinate is not one float.
    #[error(
        "field `{axis}` is {count} of type {datatype}; a coordinate is one of type 7 (float32) or 8 (float64)"
    )]
    FieldType {
        /// `x`, `y` or `z`.
        axis: char,
        /// The `datatype` found.
        datatype: u8,
        /// The `count` found.
        count: u32,
    },
    /// A coordinate reaches beyond its point.
    #[error("field `{axis}` ends at byte {end} of a point of {point_step} bytes")]
    FieldOutside {
        /// `x`, `y` or `z`.
        axis: char,
        /// End of the field, bytes from the point's start.
        end: u64,
        /// Bytes of a point.
        point_step: u32,
    },
    /// Rows overlap.
    #[error(
        "row_step is {found}, but {width} points of {point_step} bytes take {expected}, and {height} such rows do not make \
         the {data} bytes of data"
    )]
    RowStep {
        /// Rows.
        height: u32,
        /// Bytes of data.
        data: usize,
        /// Points in a row.
        width: u32,
        /// Bytes of a point.
        point_step: u32,
        /// Bytes that a row takes.
        expected: u64,
        /// Bytes from row to row.
        found: u32,
    },
    /// There is less data than the sizes say.
    #[error("{width} x {height} points need {expected} bytes of data, the message has {found}")]
    Data {
        /// Points in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes needed.
        expected: u64,
        /// Bytes there.
        found: usize,
    },
}

/// A cloud that is still in its message.
#[derive(Debug, Clone, Copy)]
pub struct PointCloud2<'a> {
    width: usize,
    height: usize,
    point_step: usize,
    row_step: usize,
    axes: [Axis; 3],
    big_endian: bool,
    data: &'a [u8],
}

/// Where in a point a coordinate is.
#[derive(Debug, Clone, Copy)]
struct Axis {
    offset: usize,
    double: bool,
}

/// A field as the message describes it.
#[derive(Clone, Copy)]
struct Field {
    offset: u32,
    datatype: u8,
    count: u32,
}

impl<'a> PointCloud2<'a> {
    /// Reads a message and checks all its sizes. Nothing is copied.
    ///
    /// # Errors
    /// What is wrong with the message.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, PointCloud2Error> {
        let mut r = Reader::in_either_order(bytes).map_err(of("the encapsulation"))?;
        r.foreign_header().map_err(of("the header"))?;
        let height = r.u32().map_err(of("height"))?;
        let width = r.u32().map_err(of("width"))?;
        let mut found = [(0, None); 3];
        for _ in 0..r.u32().map_err(of("the fields"))? {
            let name = r.text().map_err(of("the name of a field"))?;
            let field = Field {
                offset: r.u32().map_err(of("the offset of a field"))?,
                datatype: r.u8().map_err(of("the datatype of a field"))?,
                count: r.u32().map_err(of("the count of a field"))?,
            };
            if let Some(axis) = ["x", "y", "z"].iter().position(|n| *n == name) {
                found[axis] = (found[axis].0 + 1, Some(field));
            }
        }
        let big_endian = r.u8().map_err(of("is_bigendian"))? != 0;
        let point_step = r.u32().map_err(of("point_step"))?;
        let row_step = r.u32().map_err(of("row_step"))?;
        let data = r.bytes().map_err(of("the data"))?;
        let mut axes = [Axis { offset: 0, double: false }; 3];
        for (place, name) in ['x', 'y', 'z'].into_iter().enumerate() {
            axes[place] = axis(name, found[place], point_step, u64::from(width) * u64::from(height))?;
        }
        let row_step = check_sizes(width, height, point_step, row_step, data.len())?;
        Ok(Self {
            width: width as usize,
            height: height as usize,
            point_step: point_step as usize,
            row_step: row_step as usize,
            axes,
            big_endian,
            data,
        })
    }

    /// Points in a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows; 1 for an unorganised cloud.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The points, row by row, in metres; those without a return are
    /// [`INVALID_POINT`](crate::INVALID_POINT).
    pub fn points(&self) -> impl Iterator<Item = [f32; 3]> + 'a {
        let cloud = *self;
        (0..self.height).flat_map(move |row| {
            let start = row * cloud.row_step;
            (0..cloud.width).map(move |column| cloud.point(start + column * cloud.point_step))
        })
    }

    fn point(&self, at: usize) -> [f32; 3] {
        let point = self.axes.map(|axis| {
            let bytes = self.data.get(at + axis.offset..).unwrap_or_default();
            if axis.double {
                let raw = bytes.first_chunk().copied().unwrap_or_default();
                (if self.big_endian { f64::from_be_bytes(raw) } else { f64::from_le_bytes(raw) }) as f32
            } else {
                let raw = bytes.first_chunk().copied().unwrap_or_default();
                if self.big_endian { f32::from_be_bytes(raw) } else { f32::from_le_bytes(raw) }
            }
        });
        checks::point(point)
    }
}

/// The fault of a part of the message.
fn of(what: &'static str) -> impl Fn(CdrError) -> PointCloud2Error {
    move |fault| PointCloud2Error::Cdr { what, fault }
}

/// The place of a coordinate. Some drivers write the number of points as its count, or leave the count at zero.
fn axis(
    name: char,
    found: (usize, Option<Field>),
    point_step: u32,
    points: u64,
) -> Result<Axis, PointCloud2Error> {
    let (1, Some(field)) = found else {
        return Err(PointCloud2Error::Coordinate { axis: name, found: found.0 });
    };
    let Field { offset, datatype, count } = field;
    let is_one = count <= 1 || u64::from(count) == points;
    let size = match (datatype, is_one) {
        (FLOAT32, true) => 4,
        (FLOAT64, true) => 8,
        _ => return Err(PointCloud2Error::FieldType { axis: name, datatype, count }),
    };
    let end = u64::from(offset) + size;
    if end > u64::from(point_step) {
        return Err(PointCloud2Error::FieldOutside { axis: name, end, point_step });
    }
    Ok(Axis { offset: offset as usize, double: datatype == FLOAT64 })
}

/// The bytes from row to row, if the rows lie apart and the last point's end lies within the data. Some drivers leave
/// `row_step` at zero or write the size of all data: where the data are exactly the points, rows follow each other.
fn check_sizes(
    width: u32,
    height: u32,
    point_step: u32,
    row_step: u32,
    found: usize,
) -> Result<u32, PointCloud2Error> {
    let row = u64::from(width) * u64::from(point_step);
    let is_packed = row.checked_mul(u64::from(height)) == Some(found as u64);
    let is_wrong = u64::from(row_step) < row || is_packed && u64::from(row_step) != row;
    let row_step = match u32::try_from(row) {
        Ok(row) if height > 1 && is_packed => row,
        _ if height > 1 && is_wrong => {
            let (expected, data) = (row, found);
            return Err(PointCloud2Error::RowStep {
                width,
                height,
                point_step,
                expected,
                found: row_step,
                data,
            });
        }
        _ => row_step,
    };
    // The step of a single row is never taken, and some drivers leave it at zero.
    let expected = match height {
        0 => 0,
        _ => u64::from(height - 1).saturating_mul(u64::from(row_step)).saturating_add(row),
    };
    // Rows without bytes would let a short message claim any number of them.
    let empty = width == 0 || height == 0;
    if expected > found as u64 || (empty && (width, height) != (0, 0) && width.max(height) > 1) {
        return Err(PointCloud2Error::Data { width, height, expected, found });
    }
    Ok(row_step)
}
