//! What a trained network says of a case that is planned: from the image and the objectives, without any dose.

use std::sync::Arc;

use stillpoint_patient::case::Case;
use stillpoint_plan::beams::{BeamSet, Prior, Ring, RingError};
use stillpoint_plan::dose::DoseParams;
use stillpoint_plan::objectives::ObjectiveSetError;
use stillpoint_plan::recipe::{LearnedBeams, PlanRequest, RequestError, SetupSpec};
use thiserror::Error;

use crate::eye::{Eye, EyeError};
use crate::file::ModelFileError;
use crate::game::APART;
use crate::judgement::Judgement;
use crate::model::Model;

/// Angles at which the network looks.
const ANGLES: usize = 90;
/// Spacing of the grid on which the objectives of structures are looked up, mm.
const GRID_MM: f64 = 8.0;

/// The reasons why a network says nothing of a case.
#[derive(Debug, Error)]
pub enum LearnedError {
    /// The request has no use for the network.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// The model file cannot be used.
    #[error(transparent)]
    File(#[from] ModelFileError),
    /// The objectives do not fit the case.
    #[error(transparent)]
    Objectives(#[from] ObjectiveSetError),
    /// The case cannot be seen.
    #[error(transparent)]
    Eye(#[from] EyeError),
}

impl LearnedBeams for Judgement {
    fn prior(&self) -> Box<dyn Prior> {
        Box::new(self.clone())
    }

    fn proposals(&self, ring: Ring, beams: usize, most: usize) -> Result<Vec<BeamSet>, RingError> {
        self.spread_sets(ring, beams, most, APART)
    }
}

/// Gives requests for one case the network that they need: that of these bytes of a model file, or the one that comes with
/// stillpoint. Other requests get none.
///
/// # Errors
/// There are bytes and no request needs a network, the bytes are not a model, or the case cannot be seen.
pub fn with_network(
    requests: &mut [PlanRequest],
    case: &Case,
    spec: &SetupSpec,
    own: Option<&[u8]>,
) -> Result<(), LearnedError> {
    if !requests.iter().any(PlanRequest::uses_network) {
        return if own.is_some() { Err(RequestError::UnusedNetwork.into()) } else { Ok(()) };
    }
    let model = match own {
        Some(bytes) => Model::from_safetensors(bytes)?,
        None => Model::shipped()?,
    };
    let grid = DoseParams::over(case.grid(), GRID_MM).grid;
    let objective_set = spec.objectives.for_case(case, &grid)?;
    let eye = Eye::of_case(case, &objective_set.structures, &spec.machine, ANGLES, spec.bixel_mm)?;
    let judgement: Arc<dyn LearnedBeams> = Arc::new(model.judge(&eye));
    for request in requests.iter_mut().filter(|request| request.uses_network()) {
        request.network = Some(Arc::clone(&judgement));
    }
    Ok(())
}

/// A note for users of the network that comes with the project, where it was not tested or did not help; none where it did.
pub fn caution(is_pelvis: bool, beams: usize) -> Option<String> {
    match (is_pelvis, beams) {
        (false, _) => Some(
            "the network was found useful on pelves alone; on real heads and necks it chose worse than equally spaced beams; compare with --method exchange"
                .to_owned(),
        ),
        (true, 5) => None,
        (true, _) => Some(format!(
            "the network was trained on sets of five beams and not tested with {beams}; compare with --method exchange"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_patient::case::phantom;
    use stillpoint_plan::recipe::MethodName;

    #[test]
    fn a_user_is_told_where_the_network_was_not_tested() {
        assert_eq!(caution(true, 5), None);
        assert!(caution(true, 7).is_some_and(|text| text.contains("not tested with 7")));
        assert!(caution(false, 5).is_some_and(|text| text.contains("--method exchange")));
    }

    #[test]
    fn only_requests_that_need_a_network_get_one_and_a_model_without_use_is_refused() {
        let (case, spec) = (phantom(0).unwrap(), SetupSpec::shipped().unwrap());
        let of = PlanRequest::of_method;
        let mut requests = [of(MethodName::Exchange), of(MethodName::Network)];
        with_network(&mut requests, &case, &spec, None).unwrap();
        assert!(requests[0].network.is_none());
        assert!(requests[1].check(&case, spec.ring).unwrap().needed_beams().len() < 90);
        let unused = with_network(&mut [of(MethodName::Greedy)], &case, &spec, Some(b"model"));
        assert!(matches!(unused, Err(LearnedError::Request(RequestError::UnusedNetwork))));
        let broken = with_network(&mut [of(MethodName::Network)], &case, &spec, Some(b"model"));
        assert!(matches!(broken, Err(LearnedError::File(_))));
    }
}
