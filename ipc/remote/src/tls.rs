//! The certificate of a program: read, checked, and watched for a new one.

use std::fs::{self, Metadata};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::version::TLS13;
use rustls::{ClientConfig, RootCertStore};
use x509_parser::prelude::{FromDer, X509Certificate};

use crate::Role;

/// The longest file of certificates or keys that is read, bytes.
const LONGEST: u64 = 1 << 20;

/// The files by which a program shows what it is, and by which it knows others.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TlsFiles {
    /// Its certificate, PEM.
    pub certificate: PathBuf,
    /// The key of the certificate, PEM; only its owner may read it.
    pub key: PathBuf,
    /// The certificate of the authority that signs all certificates, PEM.
    pub authority: PathBuf,
}

/// Files that were read and that fit together.
#[derive(Clone, Debug)]
pub struct Tls {
    files: TlsFiles,
    role: Role,
    name: String,
    until: String,
    days_left: i64,
    stamps: [Stamp; 3],
    /// The configuration of a handshake with the same certificate that trusts this authority only.
    pub(crate) client: Arc<ClientConfig>,
}

/// Why a program has no certificate that it may use.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TlsError {
    /// A file cannot be read.
    #[error("{what} cannot be read from {}: {reason}", file.display())]
    Read {
        /// What it is to hold.
        what: &'static str,
        /// The file.
        file: PathBuf,
        /// Message of the system.
        reason: String,
    },
    /// Others may read a key.
    #[error(
        "others than its owner may read the key {} (mode {mode:o}), so it is not used: make a new one, or run `chmod 600` if no other person has read it",
        file.display()
    )]
    Open {
        /// The file.
        file: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// A file holds something else.
    #[error("{} holds no usable {what}: {reason}", file.display())]
    Content {
        /// What it is to hold.
        what: &'static str,
        /// The file.
        file: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A certificate is not valid now.
    #[error("the certificate {} {tense} on {date}: make a new one with `stillpoint pki certificate`, or set the clock of this host", file.display())]
    Dates {
        /// The file.
        file: PathBuf,
        /// Whether it has expired or is not valid yet.
        tense: &'static str,
        /// The date.
        date: String,
    },
    /// A role that is not known.
    #[error(
        "the certificate {} has the common name `{found}`, which is not a role: it must be one of {}", file.display(), Role::list()
    )]
    Role {
        /// The file.
        file: PathBuf,
        /// Its common name.
        found: String,
    },
}

/// What changes when a file is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Stamp {
    length: u64,
    modified: Option<SystemTime>,
}

impl Stamp {
    fn of(metadata: &Metadata) -> Self {
        Self { length: metadata.len(), modified: metadata.modified().ok() }
    }

    fn at(file: &Path) -> Self {
        fs::metadata(file).as_ref().map(Self::of).unwrap_or_default()
    }
}

/// Reads a file; its permissions are those of the file that was opened.
fn read(what: &'static str, file: &Path) -> Result<(Vec<u8>, Metadata), TlsError> {
    let failed = |reason: String| TlsError::Read { what, file: file.to_owned(), reason };
    let mut opened = fs::File::open(file).map_err(|e| failed(e.to_string()))?;
    let metadata = opened.metadata().map_err(|e| failed(e.to_string()))?;
    if !metadata.is_file() || metadata.len() > LONGEST {
        return Err(failed(format!("it is not a file, or longer than {LONGEST} bytes")));
    }
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut opened, &mut bytes).map_err(|e| failed(e.to_string()))?;
    Ok((bytes, metadata))
}

fn certificates(what: &'static str, file: &Path) -> Result<Vec<CertificateDer<'static>>, TlsError> {
    let wrong = |reason: String| TlsError::Content { what, file: file.to_owned(), reason };
    let (bytes, _) = read(what, file)?;
    let found: Vec<_> =
        CertificateDer::pem_slice_iter(&bytes).collect::<Result<_, _>>().map_err(|e| wrong(e.to_string()))?;
    if found.is_empty() {
        return Err(wrong("it has no part `CERTIFICATE`".to_owned()));
    }
    Ok(found)
}

/// Refuses a certificate that is not valid now. Gives the date of its end and the days until then.
fn dates(certificate: &X509Certificate<'_>, file: &Path) -> Result<(String, i64), TlsError> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs() as i64);
    let wrong = |tense, date: String| TlsError::Dates { file: file.to_owned(), tense, date };
    let validity = certificate.validity();
    if now > validity.not_after.timestamp() {
        return Err(wrong("expired", validity.not_after.to_string()));
    }
    if now < validity.not_before.timestamp() {
        return Err(wrong("becomes valid", validity.not_before.to_string()));
    }
    Ok((validity.not_after.to_string(), (validity.not_after.timestamp() - now) / 86_400))
}

impl Tls {
    /// Reads the files and checks that they can be used together now.
    ///
    /// # Errors
    /// A file is missing, is no certificate or key, has expired, may be read by others, or the key belongs to another
    /// certificate.
    pub fn load(files: &TlsFiles) -> Result<Self, TlsError> {
        let TlsFiles { certificate, key, authority } = files;
        let stamps = [certificate, key, authority].map(|file| Stamp::at(file));
        let own = certificates("certificate", certificate)?;
        let roots = certificates("authority", authority)?;
        let wrong =
            |what, file: &Path, reason: String| TlsError::Content { what, file: file.to_owned(), reason };
        let (_, parsed) = X509Certificate::from_der(&own[0])
            .map_err(|e| wrong("certificate", certificate, e.to_string()))?;
        let common =
            parsed.subject().iter_common_name().next().and_then(|n| n.as_str().ok()).unwrap_or_default();
        let name = parsed.subject().iter_organizational_unit().next().and_then(|n| n.as_str().ok());
        let role = Role::named(common)
            .ok_or_else(|| TlsError::Role { file: certificate.clone(), found: common.to_owned() })?;
        let (until, days_left) = dates(&parsed, certificate)?;
        let mut store = RootCertStore::empty();
        for root in &roots {
            let (_, parsed) =
                X509Certificate::from_der(root).map_err(|e| wrong("authority", authority, e.to_string()))?;
            dates(&parsed, authority)?;
            store.add(root.clone()).map_err(|e| wrong("authority", authority, e.to_string()))?;
        }
        let (bytes, metadata) = read("key", key)?;
        let mode = metadata.permissions().mode() & 0o777;
        if mode & 0o077 != 0 {
            return Err(TlsError::Open { file: key.clone(), mode });
        }
        // The messages about a key say nothing of its content.
        let private = PrivateKeyDer::from_pem_slice(&bytes)
            .map_err(|_| wrong("key", key, "it has no part `PRIVATE KEY`".to_owned()))?;
        let name = name.unwrap_or(common).to_owned();
        let client = ClientConfig::builder_with_provider(Arc::new(rustls::crypto::ring::default_provider()))
            .with_protocol_versions(&[&TLS13])
            .map_err(|e| wrong("key", key, e.to_string()))?
            .with_root_certificates(store)
            .with_client_auth_cert(own.clone(), private)
            .map_err(|e| wrong("key", key, format!("it does not fit the certificate: {e}")))?;
        let files = files.clone();
        Ok(Self { files, role, name, until, days_left, stamps, client: Arc::new(client) })
    }

    /// The role that the certificate gives.
    pub fn role(&self) -> Role {
        self.role
    }

    /// Whose certificate it is.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// When the certificate expires.
    pub fn until(&self) -> &str {
        &self.until
    }

    /// Days until then.
    pub fn days_left(&self) -> i64 {
        self.days_left
    }

    /// The files.
    pub fn files(&self) -> &TlsFiles {
        &self.files
    }

    /// The newly written files, if there are any and they can be used. Files that cannot be used are an error, and those
    /// that were read before stay in use.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn renewed(&self) -> Result<Option<Self>, TlsError> {
        let TlsFiles { certificate, key, authority } = &self.files;
        if [certificate, key, authority].map(|file| Stamp::at(file)) == self.stamps {
            return Ok(None);
        }
        Self::load(&self.files).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Authority;

    proptest! {
        /// A file with other bytes in it is refused, or holds what it held; nothing panics.
        #[test]
        fn damaged_files_are_refused(
            which in 0_usize..3,
            at in any::<proptest::sample::Index>(),
            with in proptest::collection::vec(any::<u8>(), 0..40),
            cut in any::<bool>(),
        ) {
            static MADE: std::sync::OnceLock<(tempfile::TempDir, [Vec<u8>; 3])> = std::sync::OnceLock::new();
            let (folder, good) = MADE.get_or_init(|| {
                let folder = tempfile::tempdir().unwrap();
                let made = Authority::create(folder.path(), 2).unwrap().issue(Role::Viewer, "v", &[], 1, false).unwrap();
                let read = |file: &Path| fs::read(file).unwrap();
                let bytes = [read(&made.certificate), read(&made.key), read(&made.authority)];
                (folder, bytes)
            });
            let names = ["v.pem", "v.key", "authority.pem"].map(|name| folder.path().join(name));
            let mut bytes = good[which].clone();
            let at = at.index(bytes.len());
            if cut { bytes.truncate(at) }
            for (offset, byte) in with.iter().enumerate() {
                if let Some(place) = bytes.get_mut(at + offset) { *place = *byte }
            }
            fs::write(&names[which], &bytes).unwrap();
            let [certificate, key, authority] = names.clone();
            if let Ok(tls) = Tls::load(&TlsFiles { certificate, key, authority }) {
                prop_assert_eq!(tls.role(), Role::Viewer);
            }
            fs::write(&names[which], &good[which]).unwrap();
        }
    }
}
