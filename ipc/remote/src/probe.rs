//! Why another end refuses this one. zenoh says only that it cannot connect, so the same certificate is shown to the same
//! port once more, and what comes back is read.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::time::Duration;

use rustls::crypto::ring;
use rustls::pki_types::ServerName;
use rustls::version::TLS13;
use rustls::{AlertDescription, CertificateError, ClientConfig, ClientConnection, Error, RootCertStore};

use crate::Tls;

/// The longest wait for an answer.
const PATIENCE: Duration = Duration::from_millis(400);

/// What the other end does with a connection of this program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// It takes it, as far as certificates go.
    Taken,
    /// It is not there.
    Absent(String),
    /// It refuses it.
    Refused(String),
}

/// Asks the end at `ADDRESS:PORT`, for at most a second.
pub fn probe(address: &str, tls: Option<&Tls>) -> Answer {
    let config = match tls {
        Some(tls) => Ok(tls.client.clone()),
        None => plain(),
    };
    let absent = |e: String| Answer::Absent(format!("no answer from {address}: {e}"));
    let place = match address.to_socket_addrs().map(|mut a| a.next()) {
        Ok(Some(place)) => place,
        Ok(None) => return absent("the name has no address".to_owned()),
        Err(e) => return absent(e.to_string()),
    };
    let stream = TcpStream::connect_timeout(&place, PATIENCE).and_then(|stream| {
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_write_timeout(Some(PATIENCE))?;
        Ok(stream)
    });
    let mut stream = match stream {
        Ok(stream) => stream,
        Err(e) => return absent(e.to_string()),
    };
    let host = address.rsplit_once(':').map_or(address, |(host, _)| host).trim_matches(['[', ']']);
    let Ok(name) = ServerName::try_from(host.to_owned()) else {
        return absent("it is not a name of a host".to_owned());
    };
    let mut connection = match config.and_then(|config| ClientConnection::new(config, name)) {
        Ok(connection) => connection,
        Err(e) => return Answer::Refused(e.to_string()),
    };
    let end = converse(&mut connection, &mut stream);
    match tls {
        Some(_) => with_certificate(address, &connection, end),
        None => without(address, end),
    }
}

/// How an attempt ended.
enum End {
    /// Nothing more came in time.
    Silence,
    /// The other end closed the connection.
    Closed,
    /// A fault of the handshake.
    Fault(Error),
}

fn converse(connection: &mut ClientConnection, stream: &mut (impl Read + Write)) -> End {
    loop {
        while connection.wants_write() {
            if connection.write_tls(stream).is_err() {
                return End::Closed;
            }
        }
        let _ = stream.flush();
        match connection.read_tls(stream) {
            Ok(0) => return End::Closed,
            Ok(_) => {}
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => return End::Silence,
            Err(_) => return End::Closed,
        }
        if let Err(error) = connection.process_new_packets() {
            // The other end is told why, as far as it listens.
            let _ = connection.write_tls(stream);
            return End::Fault(error);
        }
        // What it says after the handshake is of no use here.
        let _ = connection.reader().read(&mut [0; 64]);
    }
}

fn with_certificate(address: &str, connection: &ClientConnection, end: End) -> Answer {
    let refused = |text: String| Answer::Refused(format!("{address}: {text}"));
    match end {
        // It waits for the first message of zenoh.
        End::Silence | End::Closed if !connection.is_handshaking() => Answer::Taken,
        End::Silence => refused(format!(
            "the other end takes the connection and says nothing for {} ms: its program is stopped or busy, or does not \
             speak TLS",
            PATIENCE.as_millis()
        )),
        End::Closed => refused(
            "the other end does not speak TLS: it needs endpoints `tls/...` and a certificate, or is not a program of stillpoint"
                .to_owned(),
        ),
        End::Fault(Error::AlertReceived(alert)) => refused(alerted(alert)),
        End::Fault(Error::InvalidCertificate(reason)) => refused(match reason {
            CertificateError::UnknownIssuer | CertificateError::BadSignature => {
                "the certificate of the other end is signed by another authority than that of this host".to_owned()
            }
            CertificateError::Expired | CertificateError::ExpiredContext { .. } => {
                "the certificate of the other end has expired".to_owned()
            }
            CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. } => {
                "the certificate of the other end is not valid yet: compare the clocks".to_owned()
            }
            CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. } => {
                "the certificate of the other end is for other addresses: make one with `--address` of this one".to_owned()
            }
            other => format!("the certificate of the other end is refused: {other}"),
        }),
        End::Fault(Error::InvalidMessage(_)) => {
            refused("the other end does not speak TLS: it needs endpoints `tls/...` and a certificate".to_owned())
        }
        End::Fault(other) => refused(format!("the handshake fails: {other}")),
    }
}

/// What an alert of the other end says of this host's certificate.
fn alerted(alert: AlertDescription) -> String {
    let reason = match alert {
        AlertDescription::UnknownCA => "it is signed by another authority than that of the other end",
        AlertDescription::CertificateExpired => {
            "the other end says that it has expired: make a new one, or compare the clocks"
        }
        AlertDescription::CertificateRequired => "the other end asks for one and got none",
        AlertDescription::DecryptError | AlertDescription::BadCertificate => {
            "the other end cannot verify it: it is signed by another authority, or damaged"
        }
        other => return format!("the other end refuses the certificate of this host (alert {other:?})"),
    };
    format!("the other end refuses the certificate of this host: {reason}")
}

fn without(address: &str, end: End) -> Answer {
    match end {
        End::Fault(Error::InvalidMessage(_)) | End::Silence | End::Closed => Answer::Taken,
        End::Fault(_) => Answer::Refused(format!(
            "{address}: the other end demands TLS: write the endpoint as `tls/{address}` and give this host a certificate"
        )),
    }
}

/// A handshake that trusts nobody: it is to find out whether TLS is spoken at all.
fn plain() -> Result<Arc<ClientConfig>, Error> {
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_protocol_versions(&[&TLS13])?
        .with_root_certificates(RootCertStore::empty())
        .with_no_client_auth();
    Ok(Arc::new(config))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// An end that takes everything and answers with the same bytes always, in parts.
    struct Answers<'b>(&'b [u8]);

    impl Read for Answers<'_> {
        fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
            let (part, rest) = self.0.split_at(self.0.len().min(into.len()).min(97));
            into[..part.len()].copy_from_slice(part);
            self.0 = rest;
            Ok(part.len())
        }
    }

    impl Write for Answers<'_> {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    fn answer(bytes: &[u8]) -> Answer {
        let name = ServerName::try_from("a").unwrap();
        let mut connection = ClientConnection::new(plain().unwrap(), name).unwrap();
        let end = converse(&mut connection, &mut Answers(bytes));
        with_certificate("a:1", &connection, end)
    }

    #[test]
    fn an_alert_is_told_in_words() {
        // A record of one fatal alert: unknown authority.
        let alert = [21, 3, 3, 0, 2, 2, 48];
        assert_eq!(
            answer(&alert),
            Answer::Refused(
                "a:1: the other end refuses the certificate of this host: it is signed by another authority than that of \
                 the other end"
                    .to_owned()
            )
        );
    }

    #[test]
    fn an_end_that_is_stopped_is_not_called_a_foreign_one() {
        // The kernel takes the connection of a stopped program.
        let stopped = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = stopped.local_addr().unwrap().to_string();
        let mut connection =
            ClientConnection::new(plain().unwrap(), ServerName::try_from("a").unwrap()).unwrap();
        let mut stream = TcpStream::connect(&address).unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
        let end = converse(&mut connection, &mut stream);
        let Answer::Refused(why) = with_certificate(&address, &connection, end) else { panic!("refused") };
        assert!(why.contains("stopped or busy"), "{why}");
    }

    proptest! {
        /// Whatever a foreign end answers, nothing panics, and it is not taken for one that accepts the certificate.
        #[test]
        fn any_answer_is_a_refusal(
            (kind, version, length) in (any::<u8>(), 0_u8..5, any::<u16>()),
            bytes in proptest::collection::vec(any::<u8>(), 0..300),
            is_record in any::<bool>(),
        ) {
            let mut whole = Vec::new();
            if is_record {
                let length = if length % 2 == 0 { bytes.len() as u16 } else { length };
                whole.extend([20 + kind % 5, 3, version]);
                whole.extend(length.to_be_bytes());
            }
            whole.extend(&bytes);
            prop_assert!(matches!(answer(&whole), Answer::Refused(_)));
        }
    }
}
