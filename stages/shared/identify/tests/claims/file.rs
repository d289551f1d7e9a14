//! The model as a file.

use nalgebra::dvector;
use proptest::prelude::*;
use serde_json::{Value, json};
use stillpoint_identify::{Companion, InnovationModel, ModelError, Provenance, Signal};

fn signal(name: &str) -> Signal {
    Signal { name: name.into(), unit: "m".into(), offset: 0.1, scale: 2.0 }
}

fn model() -> InnovationModel {
    let model = Companion {
        last: dvector![-0.9883, 1.988],
        input: dvector![-3.03e-7, -4.254e-7],
        gain: dvector![0.9253, 0.9604],
        start: dvector![0.0, 0.0],
    };
    let provenance =
        Provenance { sha256: "00".into(), samples: 4000, fit_percent: 90.0, program: "test 1".into() };
    InnovationModel::new(
        &model,
        1.0 / 30.0,
        2.5e-3,
        [signal("valves.duty"), signal("filter.state:position.2")],
        provenance,
    )
    .unwrap()
}

fn changed(pointer: &str, value: Value) -> Result<InnovationModel, ModelError> {
    let mut file: Value = serde_json::from_str(&model().to_json().unwrap()).unwrap();
    *file.pointer_mut(pointer).unwrap() = value;
    InnovationModel::from_json(file.to_string().as_bytes())
}

#[test]
fn model_comes_back_from_its_file_to_the_last_bit() {
    let model = model();
    assert_eq!(InnovationModel::from_json(model.to_json().unwrap().as_bytes()).unwrap(), model);
    assert_eq!((model.order(), model.a()[(1, 1)], model.c()[0]), (2, 1.988, 1.0));
}

#[test]
fn file_whose_numbers_make_no_model_is_refused_with_the_number() {
    let refused = |pointer: &str, value: Value| changed(pointer, value).unwrap_err().to_string();
    assert!(refused("/b", json!([1.0])).contains("B has 1 numbers where the order 2 needs 2"));
    assert!(refused("/a/0", json!([1.0, 2.0, 3.0])).contains("a row of A has 3"));
    assert!(refused("/sample_time_s", json!(0.0)).contains("sample_time_s is 0"));
    assert!(refused("/noise_variance", json!(-1.0)).contains("noise_variance is -1"));
    assert!(refused("/k/0", json!(5.0)).contains("observer A - K C is unstable"));
    assert!(refused("/a/1/1", json!(2.1)).contains("it is unstable: a pole has the modulus 1.38"));
    assert!(refused("/stillpoint_model", json!(2)).contains("version 2; this build reads version 1"));
    assert!(refused("/a", json!([])).contains("the order of A is 0"));
    assert!(InnovationModel::from_json(b"{}").is_err());
}

proptest! {
    #[test]
    fn any_bytes_are_a_model_or_refused(at in 0usize..800, byte: u8, cut in 0usize..900) {
        let mut file = model().to_json().unwrap().into_bytes();
        if let Some(b) = file.get_mut(at) {
            *b = byte;
        }
        file.truncate(cut);
        let _ = InnovationModel::from_json(&file);
    }
}
