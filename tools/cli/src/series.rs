//! One number over time: a field of a topic of a session, or a column of a table.

use std::path::Path;

use sha2::{Digest, Sha256};
use stillpoint_pipeline::config::near::nearest;
use stillpoint_recorder::{Session, session_parts};
use stillpoint_samples::{Diagnostics, Field, Pieces, Sample, SampleKind};

use crate::exit::Failure;

/// The time of a sample that is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// When the sample was made: a command takes effect from then on.
    Stamp,
    /// When the data behind the sample was acquired.
    Origin,
}

/// A number over time.
pub struct Series {
    /// `topic:field`, or the column.
    pub name: String,
    /// Its unit; empty where there is none.
    pub unit: String,
    /// Time in ns and value, in the order of time.
    pub samples: Vec<(u64, f64)>,
    /// Samples that had no number.
    pub without_number: usize,
}

/// Reads `operator.port:field` from a session. `field.2` is the third number of an array; for diagnostics, the field is the
/// name of a metric.
pub fn of_session(session: &Session, signal: &str, clock: Clock) -> Result<Series, Failure> {
    let (topic, field) = signal.split_once(':').unwrap_or((signal, ""));
    let topics = session.topics();
    let Some(found) = topics.iter().find(|t| t.name == topic) else {
        let near = nearest(topic, topics.iter().map(|t| t.name.as_str()));
        let near = near.map_or_else(String::new, |n| format!(", did you mean {n}?"));
        let all: Vec<&str> = topics.iter().map(|t| t.name.as_str()).collect();
        return Err(Failure::wrong(format!(
            "the session has no topic `{topic}`{near}; it has {}",
            all.join(", ")
        )));
    };
    let Some(kind) = found.kind.kind() else {
        return Err(Failure::wrong(format!(
            "{topic}: this build does not know the type {}",
            found.type_name
        )));
    };
    let place = Place::of(kind, topic, field)?;
    let mut series =
        Series { name: signal.to_string(), unit: place.unit(), samples: Vec::new(), without_number: 0 };
    for recorded in session.samples_where(|t| t.name == topic) {
        let recorded = recorded.map_err(Failure::failed)?;
        let pieces = Pieces::split(kind, &recorded.sample).map_err(Failure::failed)?;
        let head = pieces.header();
        let time = if clock == Clock::Stamp { head.stamp } else { head.origin };
        match place.read(pieces) {
            Some(value) if value.is_finite() => series.samples.push((time, value)),
            _ => series.without_number += 1,
        }
    }
    // Samples of several sensors may pass each other; of one time the first counts.
    series.samples.sort_by_key(|(time, _)| *time);
    series.samples.dedup_by_key(|(time, _)| *time);
    Ok(series)
}

/// Where a number stands in a sample.
enum Place {
    /// In the first element.
    Element { at: usize, field: Field },
    /// A metric by its name.
    Metric(String),
}

impl Place {
    fn of(kind: &'static SampleKind, topic: &str, path: &str) -> Result<Self, Failure> {
        if *kind == *Diagnostics::KIND {
            return match path {
                "" => Err(Failure::wrong(format!("name a metric of {topic}: `{topic}:NAME`"))),
                name => Ok(Self::Metric(name.to_string())),
            };
        }
        let (name, index) = match path.rsplit_once('.') {
            Some((name, index)) => (name, Some(index)),
            None => (path, None),
        };
        let mut at = 0;
        for field in kind.element {
            if field.name == name {
                let length = field.array.max(1);
                let index = match index {
                    None if field.array == 0 => Some(0),
                    index => index.and_then(|i| i.parse().ok()).filter(|i| *i < length && field.array > 0),
                };
                let Some(index) = index else {
                    return Err(Failure::wrong(format!(
                        "{topic}:{name} has {length} numbers: write {topic}:{name}.0 to {topic}:{name}.{}",
                        length - 1
                    )));
                };
                return Ok(Self::Element { at: at + index * field.primitive.size(), field: *field });
            }
            at += field.size();
        }
        let all: Vec<String> =
            kind.element
                .iter()
                .map(|f| {
                    if f.array == 0 {
                        f.name.to_string()
                    } else {
                        format!("{}.0 to .{}", f.name, f.array - 1)
                    }
                })
                .collect();
        Err(Failure::wrong(format!(
            "{topic} has no field `{path}`: write `{topic}:FIELD` with one of {}",
            all.join(", ")
        )))
    }

    fn unit(&self) -> String {
        match self {
            // A field that names several units names one per part: none of them is this number's for sure.
            Self::Element { field, .. } if !field.unit.contains(',') => field.unit.to_string(),
            Self::Element { .. } | Self::Metric(_) => String::new(),
        }
    }

    fn read(&self, sample: Pieces<'_>) -> Option<f64> {
        match self {
            Self::Element { at, field } => {
                let bytes = sample.payload.get(*at..*at + field.primitive.size())?;
                Some(field.primitive.as_f64(bytes))
            }
            Self::Metric(name) => {
                let view = sample.view::<Diagnostics>().ok()?;
                view.elements.iter().find(|m| m.name() == name).map(|m| m.value)
            }
        }
    }
}

/// Reads columns of a table of comma-separated numbers whose first line names them. Lines are `step` ns apart.
pub fn of_table(text: &str, columns: [&str; 2], step: u64) -> Result<[Series; 2], Failure> {
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap_or("").split(',').map(str::trim).collect();
    let place = |column: &str| {
        names.iter().position(|n| *n == column).ok_or_else(|| {
            Failure::wrong(format!("the table has no column `{column}`; it has {}", names.join(", ")))
        })
    };
    let places = [place(columns[0])?, place(columns[1])?];
    let series = |k: usize| Series {
        name: columns[k].to_string(),
        unit: String::new(),
        samples: Vec::new(),
        without_number: 0,
    };
    let mut both = [series(0), series(1)];
    for (row, line) in lines.enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        for (series, place) in both.iter_mut().zip(places) {
            let value = cells.get(place).and_then(|cell| cell.parse::<f64>().ok()).ok_or_else(|| {
                let column = &series.name;
                Failure::wrong(format!("line {} of the table has no number in column `{column}`", row + 2))
            })?;
            if value.is_finite() {
                series.samples.push((row as u64 * step, value));
            } else {
                series.without_number += 1;
            }
        }
    }
    Ok(both)
}

/// SHA-256 of the concatenated parts of a session, or of one file; in hexadecimal.
pub fn sha256(path: &Path) -> Result<String, Failure> {
    let failed = |path: &Path, e: std::io::Error| Failure::failed(format!("{}: {e}", path.display()));
    let mut hash = Sha256::new();
    let parts =
        if path.is_dir() { session_parts(path).map_err(|e| failed(path, e))? } else { vec![path.to_owned()] };
    for part in parts {
        let mut file = std::fs::File::open(&part).map_err(|e| failed(&part, e))?;
        std::io::copy(&mut file, &mut hash).map_err(|e| failed(&part, e))?;
    }
    Ok(hash.finalize().iter().map(|b| format!("{b:02x}")).collect())
}
