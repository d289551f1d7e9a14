//! Why a report cannot be made.

/// Why a report cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The figures of a section cannot be written as JSON.
    #[error("the figures of a section cannot become JSON: {0}")]
    Figures(serde_json::Error),
    /// A picture cannot be encoded as PNG.
    #[error("a picture cannot become a PNG file: {0}")]
    Picture(png::EncodingError),
}
