//! The kinds of operators of the package.

use stillpoint_operator::Registry;

use crate::operators::{describe, refuse_recorded};

/// The kinds that come with stillpoint, and classes of Python, and programs. `trusts` says whether the code of sessions is run.
pub fn registry(trusts: bool) -> Registry {
    if trusts {
        stillpoint_pipeline::programs::trust_recorded();
    }
    stillpoint::registry(&[]).describing(describe, if trusts { describe } else { refuse_recorded })
}
