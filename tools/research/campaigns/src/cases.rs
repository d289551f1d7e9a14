//! Disturbances and faults during the dissertation's step: masses, valves, leaks, supply, poses, frames.

/// A disturbance or a fault.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name. The option `--case` takes its beginning.
    pub name: String,
    /// Replacements in the pipeline's text: old text and new text.
    pub changes: Vec<(String, String)>,
    /// Parameters that are set: `operator.param=value`.
    pub sets: Vec<String>,
    /// Fault of the rig in YAML, without its time.
    pub fault: Option<String>,
}

impl Case {
    fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), changes: Vec::new(), sets: Vec::new(), fault: None }
    }

    fn set(name: &str, set: &str) -> Self {
        Self { sets: vec![set.to_owned()], ..Self::new(name) }
    }

    fn fault(name: String, fault: String) -> Self {
        Self { fault: Some(fault), ..Self::new(name) }
    }

    fn change(name: &str, changes: &[(&str, &str)]) -> Self {
        let changes = changes.iter().map(|(from, to)| ((*from).to_owned(), (*to).to_owned())).collect();
        Self { changes, ..Self::new(name) }
    }

    /// The same without the camera of the rig: lost frames are lost poses, and their delay is that of the tracker and
    /// more.
    pub fn without_camera(mut self) -> Self {
        for (_, to) in &mut self.changes {
            *to = to.replace("delay: 100 ms,", "delay: 118 ms,");
        }
        for (from, _) in &mut self.changes {
            if from == "from: head.pose," {
                *from = "from: head.pose, delay: 18 ms,".to_owned();
            }
        }
        for set in &mut self.sets {
            *set = set.replace("rig.camera.lost", "head.lost");
        }
        self
    }

    pub fn all() -> Vec<Self> {
        let mut all = vec![Self::new("nothing")];
        all.extend(
            ["3 kg", "4 kg", "6 kg"]
                .map(|mass| Self::set(&format!("head of {mass}"), &format!("rig.head_mass={mass}"))),
        );
        all.extend((0..6).map(|valve| {
            let what = if valve % 2 == 0 { "inlet" } else { "outlet" };
            let name = format!("stuck {what} of bladder {}", valve / 2);
            Self::fault(name, format!("kind: stuck_valve, which: {valve}"))
        }));
        all.extend((0..3).map(|bladder| {
            let name = format!("leak of 0.5 mm in bladder {bladder}");
            Self::fault(name, format!("kind: leak, which: {bladder}, diameter: 0.5 mm"))
        }));
        // An estimator of the pressures does not know of a leak: it treats the bladder as full. Sensors measure the
        // leak.
        let mut measured = Self::fault(
            "the first leak, measured".to_owned(),
            "kind: leak, which: 0, diameter: 0.5 mm".to_owned(),
        );
        measured.changes.push((
            "      disarm: console.disarm\n".to_owned(),
            "      disarm: console.disarm\n      measured: { from: rig.state, delay: 5 ms }\n".to_owned(),
        ));
        all.push(measured);
        all.push(Self::fault("supply 20 % weaker".into(), "kind: weak_supply, left: 0.8".into()));
        // White noise of 3 % of the step in z, pitch and roll. The noise of x and y is that of z; yaw has none.
        let noise = "operators:\n  noise: { use: bench.noise, inputs: { pose: head.pose }, params: { \
                     position: [0.345 mm, 0.345 mm, 0.345 mm], angles: [0.0405 deg, 0.3 deg, 0 deg] } }\n";
        all.push(Self::change(
            "pose noise of 3 %",
            &[("operators:\n", noise), ("from: head.pose", "from: noise.pose")],
        ));
        all.push(Self::set("10 % of the frames lost", "rig.camera.lost=0.1"));
        all.push(Self::change(
            "100 ms more of latency",
            &[("from: head.pose,", "from: head.pose, delay: 100 ms,")],
        ));
        all
    }
}
