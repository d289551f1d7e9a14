//! A setting with what is wanted, what was found, and how to mend it.

use serde::Serialize;

/// The judgement of a setting, from good to bad.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// As wanted.
    Good,
    /// The system does not say, or it matters only to some pipelines.
    Unknown,
    /// The pipeline will not hold.
    Bad,
}

/// A setting that was looked at.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// What was looked at.
    pub setting: String,
    /// What is wanted.
    pub requested: String,
    /// What was found.
    pub found: String,
    /// The judgement.
    pub verdict: Verdict,
    /// How to mend it; empty where nothing is to be mended.
    pub mend: String,
    /// Whether what mends it survives a reboot.
    pub survives_reboot: bool,
}

impl Finding {
    /// A setting that is as wanted.
    pub fn good(setting: &str, requested: impl Into<String>, found: impl Into<String>) -> Self {
        Self {
            setting: setting.to_owned(),
            requested: requested.into(),
            found: found.into(),
            verdict: Verdict::Good,
            mend: String::new(),
            survives_reboot: true,
        }
    }

    /// A setting of which the system does not say enough.
    pub fn unknown(setting: &str, requested: impl Into<String>, found: impl Into<String>) -> Self {
        Self { verdict: Verdict::Unknown, ..Self::good(setting, requested, found) }
    }

    /// A setting that is not as wanted, with what mends it until the next reboot.
    pub fn bad(
        setting: &str,
        requested: impl Into<String>,
        found: impl Into<String>,
        mend: impl Into<String>,
    ) -> Self {
        Self {
            verdict: Verdict::Bad,
            mend: mend.into(),
            survives_reboot: false,
            ..Self::good(setting, requested, found)
        }
    }

    /// The same, where what mends it lasts.
    #[must_use]
    pub fn lasting(self) -> Self {
        Self { survives_reboot: true, ..self }
    }

    /// The same, as a hint: it matters only to some pipelines.
    #[must_use]
    pub fn hint(self) -> Self {
        Self { verdict: Verdict::Unknown, ..self }
    }
}
