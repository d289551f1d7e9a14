//! Which of several controllers held its target best, over all channels.

use serde::Serialize;

use super::numbers::fixed;

/// What counts as one, in mm and in degrees: what the dissertation's system is held to.
const PARTS: [f64; 2] = [0.5, 0.2];

/// A controller that held something.
#[derive(Clone, Debug)]
pub struct Contender {
    /// Its name.
    pub controller: String,
    /// Its kind, where it is known.
    pub law: Option<String>,
    /// What the person does on its rig, and the seed of that.
    pub person: Option<String>,
    /// By channel: whether it is a length, and the root mean square of what was left, in mm or degrees.
    pub held: Vec<(bool, f64)>,
}

/// How near a controller held its target.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rank {
    /// Its name.
    pub controller: String,
    /// Its kind, where it is known.
    pub law: Option<String>,
    /// Root mean square over the channels of what was left, in parts of 0.5 mm and 0.2 degrees.
    pub held: f64,
}

/// The nearest first; none where there is one alone, for it is the nearest to nobody.
pub fn ranking(contenders: &[Contender]) -> Vec<Rank> {
    let parts = |c: &Contender| {
        let squares = c.held.iter().map(|(length, rms)| (rms / PARTS[usize::from(!length)]).powi(2));
        (squares.sum::<f64>() / c.held.len() as f64).sqrt()
    };
    let rank = |c: &Contender| Rank { controller: c.controller.clone(), law: c.law.clone(), held: parts(c) };
    let mut all: Vec<Rank> = contenders.iter().filter(|c| !c.held.is_empty()).map(rank).collect();
    all.sort_by(|a, b| a.held.total_cmp(&b.held));
    if all.len() > 1 { all } else { Vec::new() }
}

/// The ranking in words, with whether it is one on the same disturbances.
pub fn said(ranking: &[Rank], contenders: &[Contender]) -> Option<String> {
    let [first, others @ ..] = ranking else { return None };
    let named = |r: &Rank| match &r.law {
        Some(law) => format!("{} ({law}, {})", r.controller, fixed(r.held, 3)),
        None => format!("{} ({})", r.controller, fixed(r.held, 3)),
    };
    let others = others.iter().map(named).collect::<Vec<_>>().join(", ");
    let mut people: Vec<Option<&str>> = contenders.iter().map(|c| c.person.as_deref()).collect();
    people.dedup();
    let people = match people.as_slice() {
        [Some(person)] => format!("On the same person ({person})"),
        _ => "On persons who differ, or of whom nothing is known,".to_owned(),
    };
    Some(format!(
        "{people} the nearest to its target over all channels, in parts of 0.5 mm and 0.2 degrees, is {}; then come {others}.",
        named(first)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_law_that_held_its_target_best_is_named_first_whichever_it_is() {
        let one = |name: &str, z: f64, roll: f64, person: &str| Contender {
            controller: name.to_owned(),
            law: Some(format!("control.{name}")),
            person: Some(person.to_owned()),
            held: vec![(true, z), (false, roll)],
        };
        let all = [one("mrac", 0.5, 0.2, "nods, seed 7"), one("pi", 0.1, 0.04, "nods, seed 7")];
        let found = ranking(&all);
        assert_eq!([found[0].controller.as_str(), found[1].controller.as_str()], ["pi", "mrac"]);
        assert!((found[0].held - 0.2).abs() < 1e-12 && (found[1].held - 1.0).abs() < 1e-12, "{found:?}");
        let words = said(&found, &all).unwrap();
        assert!(words.starts_with("On the same person (nods, seed 7) the nearest"), "{words}");
        assert!(
            words.ends_with("is pi (control.pi, 0.200); then come mrac (control.mrac, 1.000)."),
            "{words}"
        );
        let others = [all[0].clone(), one("pi", 0.1, 0.04, "nods, seed 8")];
        assert!(said(&found, &others).unwrap().starts_with("On persons who differ"));
        assert!(ranking(&all[..1]).is_empty() && said(&[], &all).is_none());
    }
}
