//! Typed values of tags, with errors that name the tag.

use dicom_core::dictionary::{DataDictionary, DataDictionaryEntry};
use dicom_core::{PrimitiveValue, Tag};
use dicom_dictionary_std::StandardDataDictionary;
use dicom_object::InMemDicomObject;
use dicom_object::mem::InMemElement;
use stillpoint_patient::case::Uid;
use thiserror::Error;

/// What is wrong with a value.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum TagError {
    /// The tag is not there, or empty.
    #[error("{} is missing: export the data again with it", named(*.0))]
    Missing(Tag),
    /// The tag is not there, or empty, and the caller can state it.
    #[error("{} is missing: {why}", named(*tag))]
    Unstated {
        /// The tag.
        tag: Tag,
        /// How to state it.
        why: &'static str,
    },
    /// The value cannot be used.
    #[error("{} is {found:?}: {why}", named(*tag))]
    Value {
        /// Tag of the element.
        tag: Tag,
        /// Value that was found.
        found: String,
        /// Why that will not do, and what will.
        why: &'static str,
    },
    /// A beam of a plan cannot be used.
    #[error("beam {name:?}: {source}")]
    Beam {
        /// Its name.
        name: String,
        /// The underlying error.
        source: Box<TagError>,
    },
    /// A contour of a structure set cannot be used.
    #[error("contour {number} of {region:?}: {source}")]
    Contour {
        /// Its place among the region's contours, from 1.
        number: usize,
        /// Name of the region.
        region: String,
        /// The underlying error.
        source: Box<TagError>,
    },
}

/// A tag with the name that the standard gives it.
pub(crate) fn named(tag: Tag) -> String {
    match StandardDataDictionary.by_tag(tag) {
        Some(entry) => format!("{tag} {}", entry.alias()),
        None => tag.to_string(),
    }
}

/// A value that will not do.
pub(crate) fn wrong<T>(tag: Tag, found: impl ToString, why: &'static str) -> Result<T, TagError> {
    Err(TagError::Value { tag, found: found.to_string().chars().take(80).collect(), why })
}

fn present(object: &InMemDicomObject, tag: Tag) -> Option<&InMemElement> {
    object.get(tag).filter(|e| e.value().primitive().is_none_or(|p| p.multiplicity() != 0))
}

/// A text, without the padding; `None` where the tag is missing or empty.
pub(crate) fn text_if_any(object: &InMemDicomObject, tag: Tag) -> Result<Option<String>, TagError> {
    let Some(element) = present(object, tag) else { return Ok(None) };
    let text = match element.value().primitive() {
        // Some converters call every element "unknown": the bytes are the text.
        Some(PrimitiveValue::U8(bytes)) => String::from_utf8_lossy(bytes).into_owned(),
        Some(value) => value.to_str().into_owned(),
        None => return wrong(tag, "a sequence", "a text is expected"),
    };
    let text = text.trim_matches(['\0', ' ']).to_owned();
    Ok((!text.is_empty()).then_some(text))
}

/// A text that must be there.
pub(crate) fn text(object: &InMemDicomObject, tag: Tag) -> Result<String, TagError> {
    text_if_any(object, tag)?.ok_or(TagError::Missing(tag))
}

/// A UID that must be there.
pub(crate) fn uid(object: &InMemDicomObject, tag: Tag) -> Result<Uid, TagError> {
    let text = text(object, tag)?;
    Uid::parse(&text).or_else(|_| wrong(tag, &text, "a UID is expected"))
}

/// Finite numbers, any count.
pub(crate) fn numbers(object: &InMemDicomObject, tag: Tag) -> Result<Vec<f64>, TagError> {
    let text = text(object, tag)?;
    parsed(tag, &text, &text)
}

/// Finite numbers, any count; an empty value after the last separator is padding.
pub(crate) fn padded_numbers(object: &InMemDicomObject, tag: Tag) -> Result<Vec<f64>, TagError> {
    let text = text(object, tag)?;
    let unpadded = text.strip_suffix('\\').unwrap_or(&text);
    parsed(tag, &text, unpadded)
}

fn parsed(tag: Tag, text: &str, parts: &str) -> Result<Vec<f64>, TagError> {
    let number = |part: &str| part.trim_matches(['\0', ' ']).parse().ok().filter(|v: &f64| v.is_finite());
    match parts.split('\\').map(number).collect() {
        Some(numbers) => Ok(numbers),
        None => wrong(tag, text, "finite numbers are expected"),
    }
}

/// Exactly `N` finite numbers.
pub(crate) fn exactly<const N: usize>(object: &InMemDicomObject, tag: Tag) -> Result<[f64; N], TagError> {
    let found = numbers(object, tag)?;
    let count = found.len();
    <[f64; N]>::try_from(found)
        .or_else(|_| wrong(tag, format!("{count} numbers"), "another count is expected"))
}

/// A whole number.
pub(crate) fn whole(object: &InMemDicomObject, tag: Tag) -> Result<i64, TagError> {
    let element = present(object, tag).ok_or(TagError::Missing(tag))?;
    if matches!(element.value().primitive(), None | Some(PrimitiveValue::U8(_))) {
        return wrong(
            tag,
            "of unknown representation",
            "a whole number is expected: convert the file so that it has one",
        );
    }
    element
        .to_int()
        .or_else(|_| wrong(tag, text_if_any(object, tag)?.unwrap_or_default(), "a whole number is expected"))
}

/// A whole number that must be this one.
pub(crate) fn must_be(
    object: &InMemDicomObject,
    tag: Tag,
    expected: i64,
    why: &'static str,
) -> Result<(), TagError> {
    match whole(object, tag)? {
        found if found == expected => Ok(()),
        found => wrong(tag, found, why),
    }
}

/// The items of a sequence; none where it is missing.
pub(crate) fn items(object: &InMemDicomObject, tag: Tag) -> &[InMemDicomObject] {
    object.get(tag).and_then(|e| e.value().items()).unwrap_or_default()
}
