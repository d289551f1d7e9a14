//! Texts in character sets that dicom-rs cannot read by itself: those that switch by escape sequences, and those in which
//! a backslash may be half of a character.
//!
//! The parser splits texts at backslashes, and takes the first of several character sets alone. So a data set in one of
//! these sets is parsed without a character set, which keeps each byte as the character of its number, and its texts are
//! decoded afterwards (DICOM PS3.5, 6.1.2.5). The codecs are those of dicom-rs.

use dicom_core::value::{DataSetSequence, Value};
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_encoding::text::{SpecificCharacterSet, TextCodec};
use dicom_object::InMemDicomObject;

const ESCAPE: u8 = 0x1B;
/// The escape sequence before JIS X 0208 and the one after it, as the codec of dicom-rs wants them.
const KANJI: [&[u8]; 2] = [b"\x1B$B", b"\x1B(B"];

/// The character sets of a data set that is decoded here.
pub(crate) struct Repertoire {
    first: SpecificCharacterSet,
}

impl Repertoire {
    /// The repertoire that this value of "Specific Character Set" names; `None` where the parser can read it.
    pub fn of(value: &str) -> Option<Self> {
        let mut terms = value.split('\\').map(|term| term.trim_matches(['\0', ' ']));
        let first = terms.next().unwrap_or_default();
        let is_wide = ["GB18030", "GBK", "GB2312"].contains(&first);
        let switches = first.starts_with("ISO 2022") || terms.next().is_some();
        let codec = || SpecificCharacterSet::from_code(first).unwrap_or_default();
        (is_wide || switches).then(|| Self { first: codec() })
    }

    /// All texts of a data set that was parsed without a character set, in this repertoire.
    pub fn decode(&self, object: InMemDicomObject) -> InMemDicomObject {
        InMemDicomObject::from_element_iter(object.into_iter().map(|element| self.element(element)))
    }

    fn element(
        &self,
        element: DataElement<InMemDicomObject, Vec<u8>>,
    ) -> DataElement<InMemDicomObject, Vec<u8>> {
        let (header, value) = element.into_parts();
        let is_text = matches!(header.vr(), VR::LO | VR::LT | VR::PN | VR::SH | VR::ST | VR::UC | VR::UT);
        let value = match value {
            Value::Sequence(sequence) => {
                let items = sequence.into_items().into_iter().map(|item| self.decode(item));
                Value::Sequence(DataSetSequence::from(items.collect::<Vec<_>>()))
            }
            Value::Primitive(text) if is_text => {
                Value::Primitive(PrimitiveValue::from(self.text(&bytes(&text.to_str()))))
            }
            other => other,
        };
        let (tag, vr): (Tag, VR) = (header.tag, header.vr());
        DataElement::new(tag, vr, value)
    }

    /// A text with its escape sequences.
    fn text(&self, bytes: &[u8]) -> String {
        let mut text = String::new();
        let mut rest = bytes;
        // Codes below 0x80 are of the set in G0: ASCII or JIS X 0208; those above of the set in G1.
        let (mut is_kanji, mut upper) = (false, self.first.clone());
        while !rest.is_empty() {
            let end = rest.iter().position(|b| *b == ESCAPE).unwrap_or(rest.len());
            let (run, after) = rest.split_at(end);
            text.push_str(&if is_kanji { kanji(run) } else { decode(&upper, run) });
            let Some((length, set)) = escape(after) else {
                // No sequence that is known: the escape character stays and is seen.
                if let Some((&escape, after)) = after.split_first() {
                    text.push(char::from(escape));
                    rest = after;
                    continue;
                }
                break;
            };
            match set {
                Set::Ascii => is_kanji = false,
                Set::Kanji => is_kanji = true,
                Set::Upper(code) => upper = SpecificCharacterSet::from_code(code).unwrap_or_default(),
                Set::Japanese(code) => {
                    is_kanji = false;
                    upper = SpecificCharacterSet::from_code(code).unwrap_or_default();
                }
            }
            rest = &after[length..];
        }
        text
    }
}

/// What an escape sequence switches to.
enum Set {
    Ascii,
    Kanji,
    Japanese(&'static str),
    Upper(&'static str),
}

/// The escape sequence at the beginning: its length, and what it switches to (PS3.3, C.12.1.1.2).
fn escape(bytes: &[u8]) -> Option<(usize, Set)> {
    let known: [(&[u8], Set); 17] = [
        (b"\x1B(B", Set::Ascii),
        (b"\x1B(J", Set::Japanese("ISO_IR 13")),
        (b"\x1B)I", Set::Upper("ISO_IR 13")),
        (b"\x1B$B", Set::Kanji),
        (b"\x1B$@", Set::Kanji),
        (b"\x1B$)C", Set::Upper("ISO_IR 149")),
        (b"\x1B$)A", Set::Upper("GBK")),
        (b"\x1B-A", Set::Upper("ISO_IR 100")),
        (b"\x1B-B", Set::Upper("ISO_IR 101")),
        (b"\x1B-C", Set::Upper("ISO_IR 109")),
        (b"\x1B-D", Set::Upper("ISO_IR 110")),
        (b"\x1B-F", Set::Upper("ISO_IR 126")),
        (b"\x1B-G", Set::Upper("ISO_IR 127")),
        (b"\x1B-H", Set::Upper("ISO_IR 138")),
        (b"\x1B-L", Set::Upper("ISO_IR 144")),
        (b"\x1B-T", Set::Upper("ISO_IR 166")),
        (b"\x1B-M", Set::Upper("ISO_IR 148")),
    ];
    known.into_iter().find_map(|(sequence, set)| bytes.starts_with(sequence).then_some((sequence.len(), set)))
}

fn kanji(run: &[u8]) -> String {
    // Codes that are no pair of JIS X 0208, such as a line break, stand for themselves.
    match SpecificCharacterSet::from_code("ISO_IR 87") {
        Some(codec) => decode(&codec, &[KANJI[0], run, KANJI[1]].concat()),
        None => decode(&SpecificCharacterSet::ISO_IR_6, run),
    }
}

fn decode(codec: &SpecificCharacterSet, run: &[u8]) -> String {
    codec.decode(run).unwrap_or_else(|_| String::from_utf8_lossy(run).into_owned())
}

/// The bytes of a text in which each byte is the character of its number.
fn bytes(text: &str) -> Vec<u8> {
    text.chars().map(|c| u8::try_from(u32::from(c)).unwrap_or(b'?')).collect()
}
