//! Roles, and what a peer of each role may send and take. Everything else is denied.

use serde_json::{Value, json};

/// What the owner of a certificate is: the common name of the certificate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// A host at the patient: sends and takes samples, and asks the planning pool.
    Bedside,
    /// A host that computes for others: sends and takes samples, and asks the planning pool.
    Cluster,
    /// Computes calls of the planning pool. It takes no samples and sends none.
    Worker,
    /// Takes samples and lists workers. It sends none.
    Viewer,
    /// Passes on what others send.
    Router,
}

impl Role {
    /// All roles.
    pub const ALL: [Self; 5] = [Self::Bedside, Self::Cluster, Self::Worker, Self::Viewer, Self::Router];

    /// The name of the role.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bedside => "bedside",
            Self::Cluster => "cluster",
            Self::Worker => "worker",
            Self::Viewer => "viewer",
            Self::Router => "router",
        }
    }

    /// The role of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.name() == name)
    }

    /// The names of all roles, for messages.
    pub fn list() -> String {
        Self::ALL.map(|role| format!("`{}`", role.name())).join(", ")
    }

    /// Whether a host of a pipeline may have it.
    pub fn is_host(self) -> bool {
        matches!(self, Self::Bedside | Self::Cluster | Self::Viewer)
    }

    /// What a peer of this role may send.
    fn sends(self, prefix: &str) -> Vec<String> {
        let name = self.name();
        let mut keys: Vec<&str> = Vec::new();
        let own = [format!("beat/{name}$*"), format!("taken/{name}$*")];
        match self {
            Self::Bedside | Self::Cluster => keys.extend(["*/*/*/*/*", "pool/1/*/plan-$*"]),
            Self::Worker => keys.extend([
                "pool/1/all/*",
                "pool/1/plan-$*/*",
                "pool/1/look-$*/*",
                "pool/1/worker-$*/worker-$*",
            ]),
            Self::Viewer => {}
            Self::Router => keys.push("**"),
        }
        let own = own.iter().filter(|_| self.is_host()).map(String::as_str);
        keys.into_iter().chain(own).map(|key| format!("{prefix}/{key}")).collect()
    }

    /// What a peer of this role may take.
    fn takes(self, prefix: &str) -> Vec<String> {
        let keys: &[&str] = match self {
            Self::Bedside | Self::Cluster => {
                &["*/*/*/*/*", "beat/*", "taken/*", "pool/1/all/*", "pool/1/plan-$*/*", "pool/1/look-$*/*"]
            }
            Self::Worker => &["pool/1/*/plan-$*", "pool/1/all/*", "pool/1/worker-$*/worker-$*"],
            Self::Viewer => &["*/*/*/*/*", "beat/*", "taken/*", "pool/1/all/*", "pool/1/look-$*/*"],
            Self::Router => &["**"],
        };
        keys.iter().map(|key| format!("{prefix}/{key}")).collect()
    }
}

/// The access list of zenoh. `ingress` is what comes from a peer, `egress` what goes to it.
///
/// A message is checked by its own key in both directions. A subscription is an expression, which may be wider than what
/// its owner may take, so subscriptions pass for every known role.
pub fn control(prefix: &str) -> Value {
    let rule = |role: Role, flow: &str, message: &str, keys: Vec<String>| {
        json!({
            "id": format!("{} {flow} {message}", role.name()),
            "permission": "allow",
            "flows": [flow],
            "messages": [message],
            "key_exprs": keys,
        })
    };
    let all = || vec![format!("{prefix}/**")];
    let rules = Role::ALL.iter().flat_map(|role| {
        [
            rule(*role, "ingress", "put", role.sends(prefix)),
            rule(*role, "egress", "put", role.takes(prefix)),
            rule(*role, "ingress", "declare_subscriber", all()),
            rule(*role, "egress", "declare_subscriber", all()),
        ]
    });
    let rules: Vec<Value> = rules.collect();
    let subjects = Role::ALL.map(|role| json!({ "id": role.name(), "cert_common_names": [role.name()] }));
    let policies = Role::ALL.map(|role| {
        let own = format!("{} ", role.name());
        let ids: Vec<&str> =
            rules.iter().filter_map(|r| r["id"].as_str()).filter(|id| id.starts_with(&own)).collect();
        json!({ "subjects": [role.name()], "rules": ids })
    });
    json!({ "enabled": true, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies })
}
