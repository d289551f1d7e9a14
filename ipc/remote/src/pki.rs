//! A small authority that makes certificates: a folder with its certificate, its key, and what it has signed.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use rcgen::{
    BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer,
    KeyPair, KeyUsagePurpose,
};
use time::{Duration, OffsetDateTime};

use crate::Role;

/// File of the authority's certificate.
const CERTIFICATE: &str = "authority.pem";
/// File of its key.
const KEY: &str = "authority.key";
/// The longest validity, days.
const MOST_DAYS: u32 = 36_500;

/// Why a certificate cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum PkiError {
    /// A file or folder cannot be used.
    #[error("{} cannot be used: {reason}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// Message of the system.
        reason: std::io::Error,
    },
    /// A file is there already.
    #[error("{} is there already, and is not replaced{hint}", file.display())]
    There {
        /// The file.
        file: PathBuf,
        /// What to do.
        hint: &'static str,
    },
    /// Others may read the key of the authority.
    #[error("others than its owner may read the key {}: make a new authority", .0.display())]
    Open(PathBuf),
    /// A name that cannot be that of a file.
    #[error(
        "`{0}` cannot be a name: it needs 1 to 64 letters, digits, `_`, `-` and `.`, and is not `authority`"
    )]
    Name(String),
    /// A validity out of range.
    #[error("{0} days: a validity is 1 to {MOST_DAYS} days")]
    Days(u32),
    /// An address that cannot be in a certificate, or another failure of the library.
    #[error("the certificate cannot be made: {0}")]
    Certificate(#[from] rcgen::Error),
}

/// An authority.
pub struct Authority {
    folder: PathBuf,
    issuer: Issuer<'static, KeyPair>,
}

/// The files of a certificate that was made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Issued {
    /// Its certificate.
    pub certificate: PathBuf,
    /// Its key.
    pub key: PathBuf,
    /// The certificate of the authority.
    pub authority: PathBuf,
}

impl Authority {
    /// Makes an authority in a folder, which is made for it.
    ///
    /// # Errors
    /// There is one already, or the folder cannot be written.
    pub fn create(folder: &Path, days: u32) -> Result<Self, PkiError> {
        check_days(days)?;
        let failed = |reason| PkiError::File { file: folder.to_owned(), reason };
        fs::DirBuilder::new().recursive(true).mode(0o700).create(folder).map_err(failed)?;
        // Two authorities have two names, or a foreign certificate would look like a damaged one.
        let made = OffsetDateTime::now_utc().unix_timestamp_nanos();
        let mut params = params(&format!("stillpoint authority {made:x}"), None, days)?;
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        let key = KeyPair::generate()?;
        let certificate = params.self_signed(&key)?;
        let hint = ": all certificates of an authority are void without it";
        for file in [KEY, CERTIFICATE] {
            refuse_if_there(&folder.join(file), hint)?;
        }
        write_new(&folder.join(KEY), &key.serialize_pem(), 0o600)?;
        write_new(&folder.join(CERTIFICATE), &certificate.pem(), 0o644)?;
        Ok(Self { folder: folder.to_owned(), issuer: Issuer::new(params, key) })
    }

    /// Opens the authority of a folder.
    ///
    /// # Errors
    /// There is none, or others may read its key.
    pub fn open(folder: &Path) -> Result<Self, PkiError> {
        let at = |file: PathBuf| move |reason| PkiError::File { file, reason };
        let (key, certificate) = (folder.join(KEY), folder.join(CERTIFICATE));
        let mode = fs::metadata(&key).map_err(at(key.clone()))?.permissions().mode();
        if mode & 0o077 != 0 {
            return Err(PkiError::Open(key));
        }
        let pair = KeyPair::from_pem(&fs::read_to_string(&key).map_err(at(key.clone()))?)?;
        let text = fs::read_to_string(&certificate).map_err(at(certificate.clone()))?;
        Ok(Self { folder: folder.to_owned(), issuer: Issuer::from_ca_cert_pem(&text, pair)? })
    }

    /// Makes a certificate for a role, with the addresses and names under which its owner is reached. With `replace`, it
    /// takes the place of an older one: the key first, then the certificate.
    ///
    /// # Errors
    /// A name, address or number of days cannot be used, or a file cannot be written.
    pub fn issue(
        &self,
        role: Role,
        name: &str,
        addresses: &[String],
        days: u32,
        replace: bool,
    ) -> Result<Issued, PkiError> {
        check_days(days)?;
        let is_plain = name.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'_' | b'-' | b'.'));
        if !(1..=64).contains(&name.len()) || !is_plain || name == "authority" || name.starts_with('.') {
            return Err(PkiError::Name(name.to_owned()));
        }
        let mut params = params(role.name(), Some(name), days)?;
        params.subject_alt_names = CertificateParams::new(addresses.to_vec())?.subject_alt_names;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages =
            vec![ExtendedKeyUsagePurpose::ClientAuth, ExtendedKeyUsagePurpose::ServerAuth];
        params.use_authority_key_identifier_extension = true;
        let key = KeyPair::generate()?;
        let certificate = params.signed_by(&key, &self.issuer)?;
        let issued = Issued {
            certificate: self.folder.join(format!("{name}.pem")),
            key: self.folder.join(format!("{name}.key")),
            authority: self.folder.join(CERTIFICATE),
        };
        let parts =
            [(&issued.key, key.serialize_pem(), 0o600), (&issued.certificate, certificate.pem(), 0o644)];
        if replace {
            for (file, text, mode) in parts {
                let new = file.with_extension("new");
                let _ = fs::remove_file(&new);
                write_new(&new, &text, mode)?;
                fs::rename(&new, file).map_err(|reason| PkiError::File { file: file.clone(), reason })?;
            }
        } else {
            parts
                .iter()
                .try_for_each(|(file, _, _)| refuse_if_there(file, ": say --replace for a new one"))?;
            parts.iter().try_for_each(|(file, text, mode)| write_new(file, text, *mode))?;
        }
        Ok(issued)
    }
}

fn check_days(days: u32) -> Result<(), PkiError> {
    if (1..=MOST_DAYS).contains(&days) { Ok(()) } else { Err(PkiError::Days(days)) }
}

fn params(common: &str, unit: Option<&str>, days: u32) -> Result<CertificateParams, PkiError> {
    let mut params = CertificateParams::new(Vec::new())?;
    params.distinguished_name = DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, common);
    if let Some(unit) = unit {
        params.distinguished_name.push(DnType::OrganizationalUnitName, unit);
    }
    let now = OffsetDateTime::now_utc();
    // Clocks of hosts differ.
    params.not_before = now - Duration::hours(1);
    params.not_after = now + Duration::days(i64::from(days));
    Ok(params)
}

fn refuse_if_there(file: &Path, hint: &'static str) -> Result<(), PkiError> {
    if fs::symlink_metadata(file).is_ok() {
        return Err(PkiError::There { file: file.to_owned(), hint });
    }
    Ok(())
}

/// Writes a file that is not there, with these permissions from its first byte on.
fn write_new(file: &Path, text: &str, mode: u32) -> Result<(), PkiError> {
    let failed = |reason| PkiError::File { file: file.to_owned(), reason };
    let mut opened = OpenOptions::new().write(true).create_new(true).mode(mode).open(file).map_err(failed)?;
    opened.write_all(text.as_bytes()).and_then(|()| opened.sync_all()).map_err(failed)
}
