//! What RTPLAN, RTDOSE and RTSTRUCT share.
//!
//! Files are explicit little endian. Nothing in them depends on a clock: dates and times that the standard allows to be
//! empty are empty, and new UIDs come from the content ([`Uid::of_content`]). So the same plan makes the same bytes.

use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use dicom_object::meta::FileMetaTableBuilder;
use stillpoint_patient::case::{Case, ContentHash, Uid, Uids};
use thiserror::Error;

use crate::identity::CaseIdentity;

/// Slices whose offsets fit into one element of 65534 bytes.
pub(crate) const MOST_FRAMES: usize = 3800;
/// Names the program in the files that it writes.
const IMPLEMENTATION: &str = "2.25.190318774136466413604873364405173126219";

/// To whom an exported object belongs.
#[derive(Clone, Copy, Debug)]
pub struct Export<'a> {
    /// Study, frame of reference and structure set of the case.
    pub uids: &'a Uids,
    /// Whose it is.
    pub identity: &'a CaseIdentity,
}

/// An object, ready to be a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exported {
    /// Its SOP Instance UID.
    pub uid: Uid,
    /// The file.
    pub bytes: Vec<u8>,
}

/// Why an object cannot be written.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ExportError {
    /// A text does not fit its tag.
    #[error("{text:?} is not a valid {what}: give 1 to {most} characters without `\\`")]
    Text {
        /// What it should be.
        what: &'static str,
        /// The text.
        text: String,
        /// How many characters fit.
        most: usize,
    },
    /// A number cannot be written.
    #[error("{what} of {value} cannot be: {why}")]
    Number {
        /// Name of the quantity.
        what: &'static str,
        /// The number.
        value: f64,
        /// Value that is expected.
        why: &'static str,
    },
    /// The dose has another number of values than its grid has voxels.
    #[error("the dose has {found} values, but its grid has {expected} voxels")]
    Length {
        /// Voxels.
        expected: usize,
        /// Values.
        found: usize,
    },
    /// The volume is larger than DICOM can count.
    #[error(
        "a grid of {0:?} voxels cannot be an RTDOSE: at most 65535 columns and rows, {MOST_FRAMES} slices, and 1 GiB in all"
    )]
    Size([usize; 3]),
    /// A plan without beams.
    #[error("a plan needs 1 to 999 beams")]
    Beams,
    /// The encoder refuses.
    #[error("the object cannot be encoded: {0}")]
    Encoder(String),
}

/// The UIDs of a case: those that it came with, or else made from its content.
pub fn uids_of(case: &Case, hash: &ContentHash) -> Uids {
    let made = |kind| Uid::of_content(kind, &hash.0);
    case.uids().cloned().unwrap_or_else(|| Uids {
        study: made("study"),
        series: made("series"),
        frame_of_reference: made("frame of reference"),
        structure_set: made("structure set"),
    })
}

/// A data set that is filled tag by tag.
pub(crate) struct Writer {
    object: InMemDicomObject,
}

impl Default for Writer {
    fn default() -> Self {
        Self { object: InMemDicomObject::new_empty() }
    }
}

impl Writer {
    pub fn put(&mut self, tag: Tag, vr: VR, value: impl Into<PrimitiveValue>) -> &mut Self {
        self.object.put(DataElement::new(tag, vr, value.into()));
        self
    }

    pub fn empty(&mut self, tag: Tag, vr: VR) -> &mut Self {
        self.put(tag, vr, PrimitiveValue::Empty)
    }

    pub fn decimals(&mut self, tag: Tag, values: &[f64]) -> &mut Self {
        let texts: Vec<String> = values.iter().map(|v| decimal(*v)).collect();
        self.put(tag, VR::DS, PrimitiveValue::Strs(texts.into()))
    }

    pub fn whole(&mut self, tag: Tag, value: usize) -> &mut Self {
        self.put(tag, VR::IS, value.to_string())
    }

    pub fn sequence(&mut self, tag: Tag, items: Vec<Writer>) -> &mut Self {
        let items: Vec<InMemDicomObject> = items.into_iter().map(|item| item.object).collect();
        self.object.put(DataElement::new(tag, VR::SQ, dicom_core::value::DataSetSequence::from(items)));
        self
    }

    /// A sequence of one reference to another object.
    pub fn reference(&mut self, tag: Tag, class: &'static str, instance: &Uid) -> &mut Self {
        let mut item = Writer::default();
        item.put(tags::REFERENCED_SOP_CLASS_UID, VR::UI, class);
        item.put(tags::REFERENCED_SOP_INSTANCE_UID, VR::UI, instance.as_str());
        self.sequence(tag, vec![item])
    }

    /// Patient, study, frame of reference and equipment.
    pub fn belongs(&mut self, export: &Export<'_>, class: &'static str, modality: &'static str) -> &mut Self {
        self.put(tags::SPECIFIC_CHARACTER_SET, VR::CS, "ISO_IR 192");
        self.put(tags::SOP_CLASS_UID, VR::UI, class).put(tags::MODALITY, VR::CS, modality);
        self.empty(tags::STUDY_DATE, VR::DA)
            .empty(tags::STUDY_TIME, VR::TM)
            .empty(tags::ACCESSION_NUMBER, VR::SH);
        self.empty(tags::REFERRING_PHYSICIAN_NAME, VR::PN).empty(tags::OPERATORS_NAME, VR::PN);
        self.put(tags::MANUFACTURER, VR::LO, "stillpoint (research software)");
        self.put(tags::MANUFACTURER_MODEL_NAME, VR::LO, "stillpoint");
        self.put(tags::SOFTWARE_VERSIONS, VR::LO, env!("CARGO_PKG_VERSION"));
        match &export.identity.retained {
            Some(retained) => {
                self.put(tags::PATIENT_NAME, VR::PN, retained.name.as_str());
                self.put(tags::PATIENT_ID, VR::LO, retained.id.as_str());
                self.put(tags::PATIENT_BIRTH_DATE, VR::DA, PrimitiveValue::Str(retained.birth_date.clone()));
                self.put(tags::PATIENT_SEX, VR::CS, retained.sex.as_str());
            }
            None => {
                self.empty(tags::PATIENT_NAME, VR::PN).empty(tags::PATIENT_ID, VR::LO);
                self.empty(tags::PATIENT_BIRTH_DATE, VR::DA).empty(tags::PATIENT_SEX, VR::CS);
                self.put(tags::PATIENT_IDENTITY_REMOVED, VR::CS, "YES");
                self.put(tags::DEIDENTIFICATION_METHOD, VR::LO, "stillpoint keeps no identity");
            }
        }
        self.put(tags::STUDY_INSTANCE_UID, VR::UI, export.uids.study.as_str());
        self.empty(tags::STUDY_ID, VR::SH).empty(tags::SERIES_NUMBER, VR::IS);
        self.put(tags::FRAME_OF_REFERENCE_UID, VR::UI, export.uids.frame_of_reference.as_str());
        self.empty(tags::POSITION_REFERENCE_INDICATOR, VR::LO)
    }

    /// The file, under UIDs that come from all that was put.
    pub fn finish(self, class: &'static str) -> Result<Exported, ExportError> {
        let content = self.content()?;
        self.file(class, Uid::of_content("instance", &content), &content)
    }

    /// The file, under this UID.
    pub fn finish_as(self, class: &'static str, uid: Uid) -> Result<Exported, ExportError> {
        let content = self.content()?;
        self.file(class, uid, &content)
    }

    fn content(&self) -> Result<Vec<u8>, ExportError> {
        use dicom_transfer_syntax_registry::entries::EXPLICIT_VR_LITTLE_ENDIAN;
        let mut content = Vec::new();
        let written = self.object.write_dataset_with_ts(&mut content, &EXPLICIT_VR_LITTLE_ENDIAN.erased());
        written.map(|()| content).map_err(|e| ExportError::Encoder(e.to_string()))
    }

    fn file(mut self, class: &'static str, uid: Uid, content: &[u8]) -> Result<Exported, ExportError> {
        let fault = |error: &dyn std::fmt::Display| ExportError::Encoder(error.to_string());
        self.put(tags::SOP_INSTANCE_UID, VR::UI, uid.as_str());
        self.put(tags::SERIES_INSTANCE_UID, VR::UI, Uid::of_content("series", content).as_str());
        let meta = FileMetaTableBuilder::new()
            .media_storage_sop_class_uid(class)
            .media_storage_sop_instance_uid(uid.as_str())
            .transfer_syntax(uids::EXPLICIT_VR_LITTLE_ENDIAN)
            .implementation_class_uid(IMPLEMENTATION)
            .implementation_version_name("STILLPOINT");
        let file = self.object.with_meta(meta).map_err(|e| fault(&e))?;
        let mut bytes = Vec::new();
        file.write_all(&mut bytes).map_err(|e| fault(&e))?;
        Ok(Exported { uid, bytes })
    }
}

/// A number as DICOM writes decimals: at most 16 characters, as near as they allow.
pub(crate) fn decimal(value: f64) -> String {
    const MOST: usize = 16;
    let shortest = value.to_string();
    if shortest.len() <= MOST {
        return shortest;
    }
    let plain = (0..MOST).rev().map(|places| format!("{value:.places$}"));
    let scientific = (0..MOST).rev().map(|places| format!("{value:.places$e}"));
    let fits = |text: &String| text.len() <= MOST;
    let error = |text: &String| (text.parse::<f64>().unwrap_or(f64::NAN) - value).abs();
    let (plain, scientific) = (plain.into_iter().find(fits), scientific.into_iter().find(fits));
    match (plain, scientific) {
        (Some(a), Some(b)) if error(&b) < error(&a) => b,
        (Some(a), _) => a,
        (None, Some(b)) => b,
        (None, None) => shortest,
    }
}

/// A text that fits its tag.
pub(crate) fn fitting<'a>(what: &'static str, text: &'a str, most: usize) -> Result<&'a str, ExportError> {
    let fits =
        (1..=most).contains(&text.chars().count()) && !text.chars().any(|c| c.is_control() || c == '\\');
    match fits {
        true => Ok(text),
        false => Err(ExportError::Text { what, text: text.chars().take(80).collect(), most }),
    }
}
