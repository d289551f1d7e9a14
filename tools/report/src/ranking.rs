//! Which of several controllers held its target best, over all channels.

use serde::Serialize;

use super::numbers::fixed;

/// The units of the ranking, mm and degrees: the tolerances of the dissertation's system.
const PARTS: [f64; 2] = [0.5, 0.2];

/// A controller with at least one target that it held.
#[derive(Clone, Debug)]
pub struct Contender {
    pub controller: String,
    /// Its kind, where it is known.
    pub law: Option<String>,
    /// The motion of the person on its rig, and its seed.
    pub person: Option<String>,
    /// By channel: whether it is a length, and the root mean square of the remaining error, in mm or degrees.
    pub held: Vec<(bool, f64)>,
}

/// How closely a controller held its target.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rank {
    pub controller: String,
    /// Its kind, where it is known.
    pub law: Option<String>,
    /// Root mean square of the remaining error over the channels, in units of 0.5 mm and 0.2 degrees.
    pub held: f64,
}

/// The controllers, the closest first; empty if there is only one controller, because a ranking needs two.
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

/// The ranking in words, and whether all controllers had the same disturbances.
pub fn sentence(ranking: &[Rank], contenders: &[Contender]) -> Option<String> {
    let [first, others @ ..] = ranking else { return None };
    let named = |r: &Rank| match &r.law {
        Some(law) => format!("{} ({law}, {})", r.controller, fixed(r.held, 3)),
        None => format!("{} ({})", r.controller, fixed(r.held, 3)),
    };
    let others = others.iter().map(named).collect::<Vec<_>>().join(", ");
    let mut people: Vec<Option<&str>> = contenders.iter().map(|c| c.person.as_deref()).collect();
    people.dedup();
    let people = match people.as_slice() {
        [Some(person)] => format!("With the same person ({person}),"),
        _ => "With persons who differ or are not known,".to_owned(),
    };
    Some(format!(
        "{people} the controller closest to its target over all channels, in units of 0.5 mm and 0.2 degrees, is {}; the \
         others follow: {others}.",
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
        let words = sentence(&found, &all).unwrap();
        assert!(words.starts_with("With the same person (nods, seed 7), the controller closest"), "{words}");
        assert!(
            words.ends_with("is pi (control.pi, 0.200); the others follow: mrac (control.mrac, 1.000)."),
            "{words}"
        );
        let others = [all[0].clone(), one("pi", 0.1, 0.04, "nods, seed 8")];
        assert!(sentence(&found, &others).unwrap().starts_with("With persons who differ"));
        assert!(ranking(&all[..1]).is_empty() && sentence(&[], &all).is_none());
    }
}
