//! Weights of bixels that another program found: a file of NumPy, or text.

use std::io::{self, ErrorKind};
use std::path::Path;

use npyz::{AutoSerialize, Deserialize, NpyFile};

use crate::exit::Failure;

/// Most bytes of the head of a file of NumPy. That of one axis of numbers has 118; brackets in a long one could nest deeper
/// than the stack of a thread.
const MOST_HEAD: u64 = 1024;

/// The reasons why a file has no weights.
#[derive(Debug, thiserror::Error)]
enum WeightsError {
    #[error("it cannot be read: {0}")]
    File(#[from] io::Error),
    #[error("it is not a file of NumPy with float64 or float32: {0}")]
    NotNumbers(io::Error),
    #[error("its head has {0} bytes (allowed: {MOST_HEAD}): save one axis of float64")]
    LongHead(u64),
    #[error("an array of shape {0:?}: one axis is expected")]
    Axes(Vec<u64>),
    #[error("it ends within number {at} of {count}: save it again")]
    Ends { at: usize, count: u64 },
    #[error("it is not a text: byte {0} is not UTF-8; the name of a file of NumPy ends in .npy")]
    NoText(usize),
    #[error("line {line}: `{text}` is not a number")]
    Number { line: usize, text: String },
    #[error("{place} {at}: invalid weight: {value} (allowed: finite and not negative)")]
    Weight { place: &'static str, at: usize, value: f64 },
}

/// Weights of a file.
pub fn read(path: &Path) -> Result<Vec<f64>, Failure> {
    let is_npy = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("npy"));
    let bytes = std::fs::read(path).map_err(WeightsError::from);
    let weights = bytes.and_then(|bytes| if is_npy { of_npy(&bytes) } else { of_text(&bytes) });
    weights.map_err(|e| Failure::wrong(format!("{}: {e}", path.display())))
}

fn of_npy(bytes: &[u8]) -> Result<Vec<f64>, WeightsError> {
    // Two bytes of length in version 1, four in later ones.
    let digits = if bytes.get(6) == Some(&1) { 2 } else { 4 };
    let length = bytes.get(8..8 + digits).unwrap_or_default().iter();
    let head = length.rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte));
    if head > MOST_HEAD {
        return Err(WeightsError::LongHead(head));
    }
    let array = NpyFile::new(bytes).map_err(WeightsError::NotNumbers)?;
    if array.shape().len() != 1 {
        return Err(WeightsError::Axes(array.shape().to_vec()));
    }
    match array.dtype() == f32::default_dtype() {
        true => numbers::<f32>(array),
        false => numbers::<f64>(array),
    }
}

fn numbers<T: Deserialize + Into<f64>>(array: NpyFile<&[u8]>) -> Result<Vec<f64>, WeightsError> {
    let count = array.len();
    let data = array.data::<T>().map_err(|e| WeightsError::NotNumbers(io::Error::other(e)))?;
    let read = data.enumerate().map(|(at, number)| match number {
        Ok(value) => checked("number", at, value.into()),
        Err(e) if e.kind() == ErrorKind::UnexpectedEof => Err(WeightsError::Ends { at, count }),
        Err(e) => Err(e.into()),
    });
    read.collect()
}

fn of_text(bytes: &[u8]) -> Result<Vec<f64>, WeightsError> {
    let text = std::str::from_utf8(bytes).map_err(|e| WeightsError::NoText(e.valid_up_to()))?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let number = |(at, line): (usize, &str)| {
        let value = line.trim().parse();
        let text = || line.trim().chars().take(40).collect();
        let value = value.map_err(|_| WeightsError::Number { line: at + 1, text: text() })?;
        checked("line", at + 1, value)
    };
    lines.map(number).collect()
}

fn checked(place: &'static str, at: usize, value: f64) -> Result<f64, WeightsError> {
    let is_weight = value.is_finite() && value >= 0.0;
    is_weight.then_some(value).ok_or(WeightsError::Weight { place, at, value })
}

#[cfg(test)]
mod tests {
    use npyz::WriterBuilder;
    use proptest::prelude::*;

    use super::*;

    fn npy(shape: &[u64], numbers: &[f64]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let options = npyz::WriteOptions::new().default_dtype().shape(shape);
        let mut writer = options.writer(&mut bytes).begin_nd().unwrap();
        writer.extend(numbers.iter().copied()).unwrap();
        writer.finish().unwrap();
        bytes
    }

    #[test]
    fn weights_are_read_and_what_are_not_is_named_with_its_place() {
        let good = npy(&[3], &[0.0, 1.5, 2.0]);
        assert_eq!(of_npy(&good).unwrap(), [0.0, 1.5, 2.0]);
        assert_eq!(of_text(b"0\n\n1.5\n2\n").unwrap(), [0.0, 1.5, 2.0]);
        let nested = {
            let head = [&b"{'descr': "[..], &[b'['; 60_000], b"\n"].concat();
            [&b"\x93NUMPY\x01\x00"[..], &(head.len() as u16).to_le_bytes(), &head].concat()
        };
        for (result, message) in [
            (of_npy(&good[..good.len() - 3]), "it ends within number 2 of 3"),
            (of_npy(&npy(&[2, 1], &[1.0, 2.0])), "an array of shape [2, 1]"),
            (of_npy(&npy(&[2], &[1.0, f64::NAN])), "number 1: invalid weight: NaN"),
            (of_npy(&nested), "its head has 60011 bytes"),
            (of_npy(b"0 1 2"), "it is not a file of NumPy"),
            (of_text(b"1\n\nx y"), "line 3: `x y` is not a number"),
            (of_text(b"1\n-1"), "line 2: invalid weight: -1"),
            (of_text(&good), "it is not a text: byte 0"),
        ] {
            let error = result.unwrap_err().to_string();
            assert!(error.contains(message), "{message}: {error}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn broken_weights_are_refused_or_are_weights(
            edits in prop::collection::vec((any::<prop::sample::Index>(), prop::collection::vec(any::<u8>(), 0..4)), 1..4),
            words in prop::collection::vec((any::<prop::sample::Index>(), "[0-9{}\\[\\](),:'<fiu]{1,8}"), 0..3),
            end in any::<prop::sample::Index>(),
            is_cut in any::<bool>(),
        ) {
            let text = b"0.5\n1\n2e3\n\n4\n".to_vec();
            for (is_npy, mut bytes) in [(true, npy(&[5], &[0.0, 1.0, 2.0, 3.0, 4.0])), (false, text)] {
                for (at, piece) in words.iter().map(|(at, word)| (at, word.as_bytes())) {
                    // The head: behind the lengths, before the numbers.
                    let at = at.index(bytes.len().min(70));
                    let to = (at + piece.len()).min(bytes.len());
                    bytes.splice(at..to, piece.iter().copied());
                }
                for (at, piece) in &edits {
                    let at = at.index(bytes.len() + 1);
                    let to = (at + piece.len()).min(bytes.len());
                    bytes.splice(at..to, piece.iter().copied());
                }
                if is_cut {
                    bytes.truncate(end.index(bytes.len() + 1));
                }
                match if is_npy { of_npy(&bytes) } else { of_text(&bytes) } {
                    Ok(weights) => {
                        prop_assert!(weights.len() <= bytes.len());
                        prop_assert!(weights.iter().all(|weight| weight.is_finite() && *weight >= 0.0));
                    }
                    Err(error) => prop_assert!((10..2000).contains(&error.to_string().len()), "{error}"),
                }
            }
        }
    }
}
