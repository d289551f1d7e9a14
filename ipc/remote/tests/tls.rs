//! Certificates: those of the same authority pass, all others are refused with the reason, and roles hold by topic.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::Arc;

use rcgen::{CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, Issuer, KeyPair};
use stillpoint_remote::{
    Authority, Endpoints, Host, Issued, Remote, RemoteError, Role, Router, Tls, TlsError, TlsFiles,
};
use stillpoint_transport::{LinkState, Transport};
use time::{Duration, OffsetDateTime};
use zenoh::Wait;

use crate::common::{channel, datagram, eventually, host, identity, send, settings, two_ports};

/// An authority in a folder of its own.
pub struct Pki {
    folder: tempfile::TempDir,
    authority: Authority,
}

impl Pki {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let authority = Authority::create(&folder.path().join("pki"), 30).unwrap();
        Self { folder, authority }
    }

    pub fn issue(&self, role: Role, name: &str) -> Issued {
        self.authority.issue(role, name, &["127.0.0.1".to_owned()], 20, false).unwrap()
    }

    fn files(&self, role: Role, name: &str) -> TlsFiles {
        files(&self.issue(role, name))
    }

    pub fn tls(&self, role: Role, name: &str) -> Option<Arc<Tls>> {
        Some(Arc::new(Tls::load(&self.files(role, name)).unwrap()))
    }
}

fn files(issued: &Issued) -> TlsFiles {
    let Issued { certificate, key, authority } = issued.clone();
    TlsFiles { certificate, key, authority }
}

fn listening(port: u16, tls: Option<Arc<Tls>>) -> Endpoints {
    Endpoints { listen: vec![endpoint(port, &tls)], tls, ..Endpoints::default() }
}

fn connecting(port: u16, tls: Option<Arc<Tls>>) -> Endpoints {
    Endpoints { connect: vec![endpoint(port, &tls)], tls, ..Endpoints::default() }
}

fn endpoint(port: u16, tls: &Option<Arc<Tls>>) -> String {
    format!("{}/127.0.0.1:{port}", if tls.is_some() { "tls" } else { "tcp" })
}

/// Waits until a host tells of a refusal with these words.
fn reported(host: &Host, words: &str) {
    let mut all = Vec::new();
    let begun = std::time::Instant::now();
    loop {
        all.extend(host.events().into_iter().map(|e| e.text));
        if all.iter().any(|text| text.contains(words)) {
            return;
        }
        assert!(begun.elapsed().as_secs() < 60, "{words}: {all:?}");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
}

fn mode(file: &Path) -> u32 {
    std::fs::metadata(file).unwrap().permissions().mode() & 0o777
}

#[test]
fn samples_pass_between_certificates_of_one_authority_directly_and_through_a_router() {
    let pki = Pki::new();
    let (bedside, cluster) = (pki.tls(Role::Bedside, "bedside"), pki.tls(Role::Cluster, "cluster"));
    let direct = two_ports();
    let routed = two_ports();
    let router = vec![format!("tls/127.0.0.1:{routed}")];
    let _router = Router::open("stillpoint-test", router.clone(), pki.tls(Role::Router, "router")).unwrap();
    let through = |tls| Endpoints { router: router.clone(), tls, ..Endpoints::default() };
    for (there, here) in [
        (listening(direct, bedside.clone()), connecting(direct, cluster.clone())),
        (through(bedside), through(cluster)),
    ] {
        let (sender, receiver) = (host("bedside", there, identity()), host("cluster", here, identity()));
        let mut taken = Remote::new(&receiver, "rig_pose_cluster").open_receiver(&channel(64)).unwrap();
        let mut sent = Remote::new(&sender, "rig_pose_cluster").open_sender(&channel(64)).unwrap();
        let mut next = 0;
        eventually("a sample passes", || {
            send(&mut *sent, &mut next);
            taken.receive(&mut Vec::new()).unwrap().is_some()
        });
    }
}

#[test]
fn a_host_of_another_authority_is_refused_and_both_sides_of_the_fault_are_named() {
    let (ours, theirs) = (Pki::new(), Pki::new());
    let port = two_ports();
    let _bedside = host("bedside", listening(port, ours.tls(Role::Bedside, "bedside")), identity());
    // Its certificate is foreign there, although it trusts the right authority.
    let mut mixed = theirs.files(Role::Cluster, "cluster");
    mixed.authority = ours.issue(Role::Cluster, "x").authority;
    let foreign = Some(Arc::new(Tls::load(&mixed).unwrap()));
    let cluster = host("cluster", connecting(port, foreign), identity());
    reported(&cluster, "refuses the certificate of this host: it is signed by another authority");
    drop(cluster);
    // The other end is foreign to it, too.
    let cluster = host("cluster", connecting(port, theirs.tls(Role::Cluster, "cluster2")), identity());
    reported(
        &cluster,
        "the certificate of the other end is signed by another authority than that of this host",
    );
    assert!(cluster.peers().is_empty());
}

#[test]
fn a_host_without_certificate_is_refused_by_one_that_has_one_and_the_other_way_round() {
    let pki = Pki::new();
    let port = two_ports();
    let bedside = host("bedside", listening(port, pki.tls(Role::Bedside, "bedside")), identity());
    let plain = host("cluster", connecting(port, None), identity());
    reported(&plain, "the other end demands TLS");
    assert!(plain.peers().is_empty() && bedside.peers().is_empty());
    drop((plain, bedside));
    let port = two_ports();
    let plain = host("bedside", listening(port, None), identity());
    let cluster = host("cluster", connecting(port, pki.tls(Role::Cluster, "cluster")), identity());
    reported(&cluster, "does not speak TLS");
    assert!(plain.peers().is_empty() && cluster.peers().is_empty());
}

#[test]
fn a_router_that_refuses_a_certificate_is_said_with_the_reason() {
    let (ours, theirs) = (Pki::new(), Pki::new());
    let endpoints = vec![format!("tls/127.0.0.1:{}", two_ports())];
    let _router =
        Router::open("stillpoint-test", endpoints.clone(), ours.tls(Role::Router, "router")).unwrap();
    let tls = theirs.tls(Role::Bedside, "bedside");
    let refused = Endpoints { router: endpoints, tls, ..Endpoints::default() };
    let error = Host::open(settings("bedside", refused, identity(), 1, 0)).err().unwrap();
    assert!(error.to_string().contains("signed by another authority"), "{error}");
}

/// A viewer hears and is heard, and may not send a sample: what it puts is lost, and counted.
#[test]
fn samples_of_a_role_that_may_send_none_do_not_arrive() {
    let pki = Pki::new();
    let port = two_ports();
    let bedside = host("bedside", listening(port, pki.tls(Role::Bedside, "bedside")), identity());
    let viewer = host("viewer", connecting(port, pki.tls(Role::Viewer, "viewer")), identity());
    let mut forged = Remote::new(&viewer, "pose").open_sender(&channel(64)).unwrap();
    let mut taken = Remote::new(&bedside, "pose").open_receiver(&channel(64)).unwrap();
    eventually("the viewer sees the receiver", || forged.state() == LinkState::Open);
    (0..20).for_each(|number| datagram(&mut *forged, number, 64));
    eventually("the bedside knows what was put", || bedside.taken()["pose"].missing == 20);
    assert!(taken.receive(&mut Vec::new()).unwrap().is_none());
    assert_eq!(bedside.taken()["pose"].received, 0);
    // The other direction is what a viewer is for.
    let mut seen = Remote::new(&viewer, "view").open_receiver(&channel(64)).unwrap();
    let mut sent = Remote::new(&bedside, "view").open_sender(&channel(64)).unwrap();
    let mut next = 0;
    eventually("the viewer sees samples", || {
        send(&mut *sent, &mut next);
        seen.receive(&mut Vec::new()).unwrap().is_some()
    });
}

/// A program that is not of this project, with a valid certificate: the access list of the router decides.
#[test]
fn a_worker_reaches_the_pool_and_forges_neither_samples_nor_beats_nor_questions() {
    let pki = Pki::new();
    let port = two_ports();
    let place = format!("tls/127.0.0.1:{port}");
    let _router =
        Router::open("stillpoint-test", vec![place.clone()], pki.tls(Role::Router, "router")).unwrap();
    let open = |role: Role, name: &str| {
        let TlsFiles { certificate, key, authority } = pki.files(role, name);
        let config = format!(
            r#"{{ mode: "client", connect: {{ endpoints: ["{place}"] }},
                scouting: {{ multicast: {{ enabled: false }}, gossip: {{ enabled: false }} }},
                transport: {{ link: {{ protocols: ["tls"], tls: {{ root_ca_certificate: {authority:?},
                connect_certificate: {certificate:?}, connect_private_key: {key:?}, enable_mtls: true }} }} }} }}"#
        );
        zenoh::open(zenoh::Config::from_json5(&config).unwrap()).wait().unwrap()
    };
    let (bedside, worker) = (open(Role::Bedside, "bedside"), open(Role::Worker, "worker"));
    let (arrived, arrives) = std::sync::mpsc::channel();
    let take = move |sample: zenoh::sample::Sample| drop(arrived.send(sample.key_expr().to_string()));
    let _all = bedside.declare_subscriber("stillpoint-test/**").callback(take).wait().unwrap();
    let forged = [
        "test/plans_plan_bedside/-/Datagram/0",
        "beat/cluster",
        "taken/cluster",
        "pool/1/worker/plan-1",
        "x",
    ];
    let allowed = "stillpoint-test/pool/1/all/worker";
    eventually("the worker is heard", || {
        forged.iter().for_each(|key| worker.put(format!("stillpoint-test/{key}"), "x").wait().unwrap());
        worker.put(allowed, "x").wait().unwrap();
        match arrives.recv_timeout(std::time::Duration::from_millis(20)) {
            Ok(key) => {
                assert_eq!(key, allowed);
                true
            }
            Err(_) => false,
        }
    });
    // Each session keeps the order of its messages, so all forged ones before this one were discarded.
    worker.put("stillpoint-test/pool/1/all/last", "x").wait().unwrap();
    loop {
        let key = arrives.recv_timeout(std::time::Duration::from_secs(60)).unwrap();
        if key.ends_with("last") {
            break;
        }
        assert_eq!(key, allowed);
    }
}

#[test]
fn roles_and_names_that_do_not_fit_are_refused_before_anything_is_opened() {
    let pki = Pki::new();
    let open =
        |name: &str, tls| Host::open(settings(name, listening(two_ports(), tls), identity(), 1, 0)).err();
    let role = open("cluster", pki.tls(Role::Worker, "worker"));
    assert!(matches!(role, Some(RemoteError::Role { role: Role::Worker, .. })), "{role:?}");
    let name = open("bedside", pki.tls(Role::Cluster, "cluster"));
    assert!(matches!(name, Some(RemoteError::HostName { role: Role::Cluster, .. })), "{name:?}");
    let endpoint = vec![format!("tls/127.0.0.1:{}", two_ports())];
    let router = Router::open("stillpoint-test", endpoint, pki.tls(Role::Viewer, "viewer")).err();
    assert!(matches!(router, Some(RemoteError::Role { role: Role::Viewer, .. })), "{router:?}");
}

#[test]
fn files_that_do_not_hold_are_refused_and_say_why() {
    let pki = Pki::new();
    let (good, other) = (pki.files(Role::Bedside, "bedside"), pki.files(Role::Worker, "worker"));
    let loaded = Tls::load(&good).unwrap();
    assert_eq!((loaded.role(), loaded.name()), (Role::Bedside, "bedside"));
    assert!((19..=20).contains(&loaded.days_left()));
    assert_eq!((mode(&good.key), mode(&pki.folder.path().join("pki/authority.key"))), (0o600, 0o600));
    let secret = std::fs::read_to_string(&good.key).unwrap();
    let secret = secret.lines().nth(1).unwrap();
    assert!(!format!("{loaded:?}").contains(secret));

    let refused = |files: &TlsFiles| Tls::load(files).unwrap_err();
    let mixed = TlsFiles { key: other.key.clone(), ..good.clone() };
    assert!(refused(&mixed).to_string().contains("does not fit the certificate"), "{}", refused(&mixed));
    let missing = TlsFiles { certificate: "/nowhere".into(), ..good.clone() };
    assert!(matches!(refused(&missing), TlsError::Read { what: "certificate", .. }));
    std::fs::set_permissions(&good.key, std::fs::Permissions::from_mode(0o640)).unwrap();
    assert!(matches!(refused(&good), TlsError::Open { mode: 0o640, .. }), "{}", refused(&good));
    std::fs::set_permissions(&good.key, std::fs::Permissions::from_mode(0o600)).unwrap();

    // The last day of this one was long ago.
    let mut params = rcgen::CertificateParams::new(vec!["127.0.0.1".to_owned()]).unwrap();
    params.not_after = rcgen::date_time_ymd(2020, 1, 1);
    params.distinguished_name.push(rcgen::DnType::CommonName, "bedside");
    let key = rcgen::KeyPair::generate().unwrap();
    std::fs::write(&good.certificate, params.self_signed(&key).unwrap().pem()).unwrap();
    let error = refused(&good).to_string();
    assert!(error.contains("expired on Jan  1") && error.contains("2020"), "{error}");
}

#[test]
fn a_listening_host_notices_a_new_certificate_and_passes_samples_with_it() {
    let pki = Pki::new();
    let port = two_ports();
    let old = pki.issue(Role::Bedside, "bedside");
    let open = || {
        let tls = Some(Arc::new(Tls::load(&files(&old)).unwrap()));
        host("bedside", listening(port, tls), identity())
    };
    let bedside = open();
    let cluster = host("cluster", connecting(port, pki.tls(Role::Cluster, "cluster")), identity());
    eventually("the hosts meet", || !cluster.peers().is_empty());
    assert!(!bedside.is_outdated());
    let repeated = pki.authority.issue(Role::Bedside, "bedside", &["127.0.0.1".to_owned()], 25, false);
    assert!(repeated.is_err(), "a certificate is replaced only when asked");
    pki.authority.issue(Role::Bedside, "bedside", &["127.0.0.1".to_owned()], 25, true).unwrap();
    eventually("the host notices", || bedside.is_outdated());
    drop(bedside);
    let bedside = Host::open(settings(
        "bedside",
        listening(port, Some(Arc::new(Tls::load(&files(&old)).unwrap()))),
        identity(),
        2,
        0,
    ))
    .unwrap();
    let mut taken = Remote::new(&cluster, "pose").open_receiver(&channel(64)).unwrap();
    let mut sent = Remote::new(&bedside, "pose").open_sender(&channel(64)).unwrap();
    let mut next = 0;
    eventually("samples pass again", || {
        send(&mut *sent, &mut next);
        taken.receive(&mut Vec::new()).unwrap().is_some()
    });
}

/// Writes a certificate that ends soon in the place of one that was issued.
fn shorten(issued: &Issued, role: Role, seconds: i64) {
    let read = |file: &Path| std::fs::read_to_string(file).unwrap();
    let pair = KeyPair::from_pem(&read(&issued.authority.with_extension("key"))).unwrap();
    let issuer = Issuer::from_ca_cert_pem(&read(&issued.authority), pair).unwrap();
    let mut params = CertificateParams::new(vec!["127.0.0.1".to_owned()]).unwrap();
    params.distinguished_name = DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, role.name());
    params.extended_key_usages =
        vec![ExtendedKeyUsagePurpose::ClientAuth, ExtendedKeyUsagePurpose::ServerAuth];
    params.use_authority_key_identifier_extension = true;
    let now = OffsetDateTime::now_utc();
    (params.not_before, params.not_after) = (now - Duration::hours(1), now + Duration::seconds(seconds));
    let key = KeyPair::from_pem(&read(&issued.key)).unwrap();
    std::fs::write(&issued.certificate, params.signed_by(&key, &issuer).unwrap().pem()).unwrap();
}

#[test]
fn a_certificate_that_ends_during_a_run_closes_the_link_until_there_is_a_new_one() {
    let pki = Pki::new();
    let port = two_ports();
    let bedside = host("bedside", listening(port, pki.tls(Role::Bedside, "bedside")), identity());
    let issued = pki.issue(Role::Cluster, "cluster");
    // Long enough for two hosts to meet on a busy machine.
    shorten(&issued, Role::Cluster, 15);
    let tls = Some(Arc::new(Tls::load(&files(&issued)).unwrap()));
    let cluster = host("cluster", connecting(port, tls), identity());
    let mut taken = Remote::new(&cluster, "pose").open_receiver(&channel(64)).unwrap();
    let mut sent = Remote::new(&bedside, "pose").open_sender(&channel(64)).unwrap();
    let mut next = 0;
    eventually("samples pass", || {
        send(&mut *sent, &mut next);
        taken.receive(&mut Vec::new()).unwrap().is_some()
    });
    eventually("the link closes with the certificate", || sent.state() != LinkState::Open);
    pki.authority.issue(Role::Cluster, "cluster", &["127.0.0.1".to_owned()], 20, true).unwrap();
    while taken.receive(&mut Vec::new()).unwrap().is_some() {}
    eventually("samples pass with the new certificate", || {
        send(&mut *sent, &mut next);
        taken.receive(&mut Vec::new()).unwrap().is_some()
    });
}
