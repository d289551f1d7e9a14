//! Checks the lengths in a file before a parser trusts them.
//!
//! A DICOM element states its length, and sequences nest. A parser that allocates what a broken file claims, or nests
//! as deep as it claims, can be brought down by a few bytes. So every length is first compared with the bytes that are
//! left, and the depth is bounded. This also names the tag at which a file is cut off.

use std::ops::Range;

use dicom_core::dictionary::{DataDictionary, DataDictionaryEntry};
use dicom_core::{Tag, VR};
use dicom_dictionary_std::{StandardDataDictionary, uids};
use thiserror::Error;

/// RT objects nest four deep; more than this is no such object.
const DEEPEST: usize = 16;
/// Bytes before the mark of a file.
pub(crate) const PREAMBLE: usize = 128;
const UNDEFINED: u32 = u32::MAX;

const ITEM: Tag = Tag(0xFFFE, 0xE000);
const ITEM_END: Tag = Tag(0xFFFE, 0xE00D);
const SEQUENCE_END: Tag = Tag(0xFFFE, 0xE0DD);
const CHARACTER_SET: Tag = Tag(0x0008, 0x0005);
const PIXEL_DATA: Tag = Tag(0x7FE0, 0x0010);

/// How the elements are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Without value representations.
    Implicit,
    /// With value representations.
    Explicit,
}

/// Where the data set of a file begins, and how it is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// First byte of the data set.
    pub start: usize,
    /// How it is written.
    pub encoding: Encoding,
    /// The transfer syntax, where the pixels are compressed.
    pub compressed: Option<String>,
    /// Where the value of "Specific Character Set" is.
    pub character_set: Option<Range<usize>>,
}

/// Why bytes are no data set.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum LayoutError {
    /// Another kind of file.
    #[error("this is not a DICOM file, or it ends before its first element; copy it again, or take it away")]
    NotDicom,
    /// The file ends within an element.
    #[error("the file is cut off: {tag} at byte {at} needs {length} bytes, {left} are left; copy it again")]
    Short {
        /// The element.
        tag: Tag,
        /// Offset of its first byte in the file.
        at: usize,
        /// Bytes that it says it has.
        length: u64,
        /// Bytes that are left, in the file or in the sequence around it.
        left: usize,
    },
    /// The file ends where an element should begin.
    #[error("the file is cut off after {tag}, at byte {at}; copy it again")]
    End {
        /// The last element.
        tag: Tag,
        /// Offset in the file, bytes.
        at: usize,
    },
    /// Sequences are too deep.
    #[error("sequences nest more than {DEEPEST} deep at {tag}, byte {at}: this is not an RT object")]
    Deep {
        /// The element.
        tag: Tag,
        /// Offset of its first byte in the file.
        at: usize,
    },
    /// An element at a place where it is not allowed.
    #[error("{tag} at byte {at} {why}: the file is damaged, or written wrongly; export it again")]
    Wrong {
        /// The element.
        tag: Tag,
        /// Offset of its first byte in the file.
        at: usize,
        /// Description of the fault.
        why: &'static str,
    },
    /// A transfer syntax that is not read.
    #[error(
        "(0002,0010) Transfer Syntax {0} is not read: convert the file to explicit little endian (for example `dcmconv +te`)"
    )]
    Syntax(String),
}

/// Whether the lengths of this file hold together, and where its data set is.
pub fn layout(bytes: &[u8]) -> Result<Layout, LayoutError> {
    let mut walk = Walk { bytes, at: 0, last: Tag(0, 0), character_set: None };
    let layout = if bytes.get(PREAMBLE..PREAMBLE + 4) == Some(b"DICM") {
        walk.at = PREAMBLE + 4;
        let syntax = walk.meta()?;
        of_syntax(walk.at, syntax)?
    } else {
        bare(bytes)?
    };
    walk.elements(bytes.len(), layout.encoding, 0, Until::End)?;
    Ok(Layout { character_set: walk.character_set, ..layout })
}

fn of_syntax(start: usize, syntax: Option<String>) -> Result<Layout, LayoutError> {
    let plain = |encoding| Ok(Layout { start, encoding, compressed: None, character_set: None });
    match syntax.as_deref() {
        // Implicit little endian is what DICOM means where it says nothing (PS3.5, 10.1).
        None | Some(uids::IMPLICIT_VR_LITTLE_ENDIAN) => plain(Encoding::Implicit),
        Some(uids::EXPLICIT_VR_LITTLE_ENDIAN) => plain(Encoding::Explicit),
        Some("1.2.840.10008.1.2.2" | "1.2.840.10008.1.2.1.99") => {
            Err(LayoutError::Syntax(syntax.unwrap_or_default()))
        }
        // All others write explicit little endian around compressed pixels (PS3.5, A.4).
        Some(_) => {
            Ok(Layout { start, encoding: Encoding::Explicit, compressed: syntax, character_set: None })
        }
    }
}

/// The layout of a data set without preamble and file meta information, as some programs write it.
fn bare(bytes: &[u8]) -> Result<Layout, LayoutError> {
    // It begins with group 8, in which the elements below 0x0018 stand first.
    let Some(&[0x08, 0x00, element, 0x00, a, b, c, d]) = bytes.get(..8) else {
        return Err(LayoutError::NotDicom);
    };
    let explicit = a.is_ascii_uppercase() && b.is_ascii_uppercase();
    let fits = u32::from_le_bytes([a, b, c, d]) as usize <= bytes.len() - 8;
    if element > 0x18 || !(explicit || fits) {
        return Err(LayoutError::NotDicom);
    }
    let encoding = if explicit { Encoding::Explicit } else { Encoding::Implicit };
    Ok(Layout { start: 0, encoding, compressed: None, character_set: None })
}

struct Walk<'a> {
    bytes: &'a [u8],
    at: usize,
    last: Tag,
    character_set: Option<Range<usize>>,
}

/// What ends a run of elements.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Until {
    /// The end of the bytes.
    End,
    /// The delimiter of an item.
    ItemEnd,
}

/// The head of an element.
struct ElementHeader {
    tag: Tag,
    vr: VR,
    length: u32,
}

impl Walk<'_> {
    /// The transfer syntax of the file meta information, which is explicit whatever follows.
    fn meta(&mut self) -> Result<Option<String>, LayoutError> {
        let mut syntax = None;
        while self.bytes.get(self.at..self.at + 2) == Some(&[2, 0]) {
            let at = self.at;
            let head = self.head(self.bytes.len(), Encoding::Explicit)?;
            let value = self.value(&head, at, self.bytes.len())?;
            if head.tag == Tag(0x0002, 0x0010) {
                let text = String::from_utf8_lossy(value);
                syntax = Some(text.trim_end_matches(['\0', ' ']).chars().take(64).collect());
            }
        }
        Ok(syntax)
    }

    fn elements(
        &mut self,
        end: usize,
        encoding: Encoding,
        depth: usize,
        until: Until,
    ) -> Result<(), LayoutError> {
        while self.at < end {
            let at = self.at;
            let head = self.head(end, encoding)?;
            if head.tag == ITEM_END && until == Until::ItemEnd && head.length == 0 {
                return Ok(());
            }
            if head.tag.group() == 0xFFFE {
                return Err(LayoutError::Wrong { tag: head.tag, at, why: "is outside a sequence" });
            }
            self.last = head.tag;
            let within = match head.length {
                UNDEFINED => None,
                _ => Some(self.at + self.fits(&head, at, end)?),
            };
            if head.tag == PIXEL_DATA && within.is_none() {
                self.fragments(end)?;
            } else if head.vr == VR::SQ {
                if depth == DEEPEST {
                    return Err(LayoutError::Deep { tag: head.tag, at });
                }
                self.items(within, end, encoding, depth + 1)?;
            } else if let Some(after) = within {
                if depth == 0 && head.tag == CHARACTER_SET {
                    self.character_set = Some(self.at..after);
                }
                self.at = after;
            } else {
                return Err(LayoutError::Wrong { tag: head.tag, at, why: "has no length" });
            }
        }
        match until {
            Until::End => Ok(()),
            Until::ItemEnd => Err(LayoutError::End { tag: self.last, at: end }),
        }
    }

    fn items(
        &mut self,
        within: Option<usize>,
        end: usize,
        encoding: Encoding,
        depth: usize,
    ) -> Result<(), LayoutError> {
        let stop = within.unwrap_or(end);
        while self.at < stop {
            let at = self.at;
            let head = self.head(stop, Encoding::Implicit)?;
            match head.tag {
                ITEM if head.length == UNDEFINED => self.elements(stop, encoding, depth, Until::ItemEnd)?,
                ITEM => {
                    let after = self.at + self.fits(&head, at, stop)?;
                    self.elements(after, encoding, depth, Until::End)?;
                }
                SEQUENCE_END if within.is_none() => return Ok(()),
                tag => {
                    return Err(LayoutError::Wrong {
                        tag,
                        at,
                        why: "is where an item of a sequence is expected",
                    });
                }
            }
        }
        match within {
            Some(_) => Ok(()),
            None => Err(LayoutError::End { tag: self.last, at: stop }),
        }
    }

    /// The pieces of compressed pixel data.
    fn fragments(&mut self, end: usize) -> Result<(), LayoutError> {
        while self.at < end {
            let at = self.at;
            let head = self.head(end, Encoding::Implicit)?;
            match head.tag {
                ITEM if head.length != UNDEFINED => {
                    self.value(&head, at, end)?;
                }
                SEQUENCE_END => return Ok(()),
                tag => {
                    return Err(LayoutError::Wrong {
                        tag,
                        at,
                        why: "is where a piece of pixel data is expected",
                    });
                }
            }
        }
        Err(LayoutError::End { tag: PIXEL_DATA, at: end })
    }

    fn head(&mut self, end: usize, encoding: Encoding) -> Result<ElementHeader, LayoutError> {
        let at = self.at;
        let cut = LayoutError::End { tag: self.last, at };
        let bytes = self.bytes.get(at..end).unwrap_or_default();
        let &[g0, g1, e0, e1, a, b, c, d, ..] = bytes else { return Err(cut) };
        let tag = Tag(u16::from_le_bytes([g0, g1]), u16::from_le_bytes([e0, e1]));
        if encoding == Encoding::Implicit || tag.group() == 0xFFFE {
            let vr = match tag.group() {
                0xFFFE => VR::UN,
                _ => StandardDataDictionary.by_tag(tag).map_or(VR::UN, |entry| entry.vr().relaxed()),
            };
            self.at += 8;
            return Ok(ElementHeader { tag, vr, length: u32::from_le_bytes([a, b, c, d]) });
        }
        let Some(vr) = VR::from_binary([a, b]) else {
            return Err(LayoutError::Wrong { tag, at, why: "has no value representation that DICOM knows" });
        };
        if !is_long(vr) {
            self.at += 8;
            return Ok(ElementHeader { tag, vr, length: u32::from(u16::from_le_bytes([c, d])) });
        }
        let Some(&[l0, l1, l2, l3]) = bytes.get(8..12) else { return Err(cut) };
        self.at += 12;
        Ok(ElementHeader { tag, vr, length: u32::from_le_bytes([l0, l1, l2, l3]) })
    }

    /// The length of a value, if it ends before `end`.
    fn fits(&self, head: &ElementHeader, at: usize, end: usize) -> Result<usize, LayoutError> {
        let left = end.saturating_sub(self.at);
        match head.length as usize <= left {
            true => Ok(head.length as usize),
            false => Err(LayoutError::Short { tag: head.tag, at, length: head.length.into(), left }),
        }
    }

    fn value(&mut self, head: &ElementHeader, at: usize, end: usize) -> Result<&[u8], LayoutError> {
        let length = self.fits(head, at, end)?;
        let value = &self.bytes[self.at..self.at + length];
        self.at += length;
        Ok(value)
    }
}

/// Whether a value representation is written with a length of 32 bits (PS3.5, 7.1.2).
fn is_long(vr: VR) -> bool {
    use VR::{OB, OD, OF, OL, OV, OW, SQ, SV, UC, UN, UR, UT, UV};
    matches!(vr, OB | OD | OF | OL | OV | OW | SQ | SV | UC | UN | UR | UT | UV)
}
