//! `stillpoint reach`

use clap::Args;
use clap::builder::PossibleValuesParser;
use serde::Serialize;
use stillpoint_control::channels::{ALL, Channel};
use stillpoint_control::rig::{Obstacle, RIGS, Rig, RigKind, RigSpec};
use stillpoint_pipeline::config::quantity::si;

use crate::exit::{Ended, Exit, Failure, print_json};

/// Default range of a channel, m and rad.
const SPANS: [[f64; 2]; 6] =
    [[-0.06, 0.06], [-0.12, 0.12], [-0.05, 0.1], [-0.7, 0.7], [-0.8, 0.8], [-1.0, 1.0]];

/// Print a map of the targets that a rig can hold, as `control.target` with `rig:` judges them: no bladder may pull or
/// exceed its pressure or its stretch anywhere on the straight way from the initial rest position. Two coordinates vary
/// over the map, one from left to right and one upwards; the others are constant.
#[derive(Args)]
pub struct Reach {
    /// The rig.
    #[arg(default_value = "three_bladders", value_parser = PossibleValuesParser::new(RIGS.map(|rig| rig.name)))]
    rig: String,
    /// A coordinate that varies over the map, such as `z`, or with its range of distances from the start, such as
    /// `z=-20 mm..40 mm`. Give it twice.
    #[arg(long = "over", value_name = "CHANNEL[=FROM..TO]")]
    over: Vec<String>,
    /// The constant value of another coordinate, such as `pitch=1.35 deg`; the default is 0.
    #[arg(long = "at", value_name = "CHANNEL=DISTANCE")]
    at: Vec<String>,
    /// Mass of the head.
    #[arg(long, default_value = "5 kg")]
    head_mass: String,
    /// Number of places from left to right.
    #[arg(long, default_value_t = 61, value_parser = clap::value_parser!(u16).range(2..=1000))]
    columns: u16,
    /// Number of places upwards.
    #[arg(long, default_value_t = 25, value_parser = clap::value_parser!(u16).range(2..=1000))]
    rows: u16,
    /// Print JSON, with the limit that excludes each place.
    #[arg(long)]
    json: bool,
}

/// The default coordinates of the map: the height, and the roll if the rig moves it. With one coordinate the map is a line.
fn over_by_itself(spec: &RigSpec) -> [Channel; 2] {
    [Channel::Z, if spec.channels.contains(&Channel::Roll.place()) { Channel::Roll } else { Channel::Z }]
}

/// A coordinate that varies over the map.
#[derive(Clone, Debug, Serialize)]
struct Axis {
    channel: &'static str,
    /// `mm` or `deg`.
    unit: &'static str,
    /// Distances from the start.
    values: Vec<f64>,
    #[serde(skip)]
    place: usize,
    #[serde(skip)]
    scale: f64,
}

/// The limit that excludes a place.
#[derive(Clone, Debug, Serialize)]
struct Wall {
    bladder: Option<usize>,
    /// The part of the way that can be held, 0 to 1.
    part: f64,
    why: String,
}

#[derive(Serialize)]
struct Map {
    rig: &'static str,
    head_mass_kg: f64,
    /// From left to right.
    across: Axis,
    /// Upwards.
    up: Axis,
    /// The constant values of the other coordinates, mm and degrees.
    at: std::collections::BTreeMap<&'static str, f64>,
    held: usize,
    /// Row by row, from the smallest value of `up`; none if a place can be held.
    map: Vec<Vec<Option<Wall>>>,
}

impl Reach {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let map = self.map()?;
        if self.json {
            print_json(&map)?
        } else {
            print(&map)
        }
        Ok(Exit::Done)
    }

    fn map(&self) -> Result<Map, Failure> {
        let mass = number("--head-mass", &self.head_mass, "kg")?;
        if !(1.0..=10.0).contains(&mass) {
            return Err(Failure::wrong(format!(
                "--head-mass {}: the mass must be from 1 kg to 10 kg",
                self.head_mass
            )));
        }
        let spec =
            RigSpec::named(&self.rig).ok_or_else(|| Failure::wrong(format!("{}: no such rig", self.rig)))?;
        let rig = Rig::of(RigKind::known(spec), mass)
            .map_err(|e| Failure::wrong(format!("--head-mass {}: {e}", self.head_mass)))?;
        let [across, up] = self.axes(spec, &rig)?;
        let mut stays = [0.0; 6];
        let mut at = std::collections::BTreeMap::new();
        for reason in &self.at {
            let (name, distance) = reason
                .split_once('=')
                .ok_or_else(|| Failure::wrong(format!("--at {reason}: write it as `pitch=1.35 deg`")))?;
            let channel = channel(&rig, name, reason)?;
            let value = number(reason, distance, channel.unit())?;
            stays[channel.place()] = value;
            at.insert(channel.name(), value * scale(channel).1);
        }
        let wall = |obstacle: Obstacle| Wall {
            bladder: obstacle.bladder(),
            part: obstacle.part,
            why: obstacle.why.to_string(),
        };
        let place = |x: f64, y: f64| {
            let mut to = stays;
            to[up.place] = y / up.scale;
            to[across.place] = x / across.scale;
            rig.check(&[0.0; 6], &to).err().map(wall)
        };
        let map: Vec<Vec<_>> =
            up.values.iter().map(|y| across.values.iter().map(|x| place(*x, *y)).collect()).collect();
        let held = map.iter().flatten().filter(|wall| wall.is_none()).count();
        Ok(Map { rig: spec.name, head_mass_kg: mass, across, up, at, held, map })
    }

    fn axes(&self, spec: &RigSpec, rig: &Rig) -> Result<[Axis; 2], Failure> {
        let reason: Vec<String> = match self.over.len() {
            0 => over_by_itself(spec).map(|channel| channel.name().to_owned()).to_vec(),
            2 => self.over.clone(),
            _ => return Err(Failure::wrong("--over: give two coordinates, such as `--over z --over roll`")),
        };
        let counts =
            [self.columns, if self.over.is_empty() && spec.channels.len() == 1 { 1 } else { self.rows }];
        let axis = |reason: &String, count: u16| -> Result<Axis, Failure> {
            let (name, span) = reason.split_once('=').map_or((reason.as_str(), None), |(n, s)| (n, Some(s)));
            let channel = channel(rig, name, reason)?;
            let [from, to] = match span {
                None => SPANS[channel.place()],
                Some(span) => {
                    let (from, to) = span.split_once("..").ok_or_else(|| {
                        Failure::wrong(format!("--over {reason}: write it as `z=-20 mm..40 mm`"))
                    })?;
                    [number(reason, from, channel.unit())?, number(reason, to, channel.unit())?]
                }
            };
            let (unit, scale) = scale(channel);
            let steps = f64::from(count.saturating_sub(1).max(1));
            let values = (0..count).map(|i| (from + (to - from) * f64::from(i) / steps) * scale).collect();
            Ok(Axis { channel: channel.name(), unit, values, place: channel.place(), scale })
        };
        let axes = [axis(&reason[0], counts[0])?, axis(&reason[1], counts[1])?];
        if axes[0].place == axes[1].place && counts[1] > 1 {
            return Err(Failure::wrong(format!("--over {}: it is named twice", reason[1])));
        }
        Ok(axes)
    }
}

/// The channel of this name, which the rig has to move.
fn channel(rig: &Rig, name: &str, reason: &str) -> Result<Channel, Failure> {
    let moved =
        || ALL.into_iter().filter(|c| rig.moves(*c)).map(Channel::name).collect::<Vec<_>>().join(", ");
    Channel::named(name.trim())
        .filter(|channel| rig.moves(*channel))
        .ok_or_else(|| Failure::wrong(format!("`{reason}`: the rig moves {}", moved())))
}

/// The unit in which a channel is shown, and its number per m or rad.
fn scale(channel: Channel) -> (&'static str, f64) {
    if channel.unit() == "m" { ("mm", 1e3) } else { ("deg", 1f64.to_degrees()) }
}

fn number(reason: &str, text: &str, unit: &str) -> Result<f64, Failure> {
    si(text.trim(), unit).map_err(|e| Failure::wrong(format!("`{reason}`: {}; {}", e.message, e.help)))
}

fn print(map: &Map) {
    let Map { across, up, .. } = map;
    let at: Vec<String> = map.at.iter().map(|(name, value)| format!(", {name} at {value:.2}")).collect();
    let all = across.values.len() * up.values.len();
    outln!(
        "a head of {} kg{}: {} of {all} places can be held (.); a digit is the limiting bladder, counted from 0",
        map.head_mass_kg,
        at.concat(),
        map.held
    );
    for (y, row) in up.values.iter().zip(&map.map).rev() {
        let cells: String = row.iter().map(mark).collect();
        outln!("{y:>9.1} {} {cells}", up.unit);
    }
    let (first, last) = (across.values.first(), across.values.last());
    let ends =
        first.zip(last).map(|(a, b)| format!("{} from {a:.1} to {b:.1} {}", across.channel, across.unit));
    outln!("upwards {}; {}", up.channel, ends.unwrap_or_default());
}

fn mark(wall: &Option<Wall>) -> char {
    match wall {
        None => '.',
        Some(wall) => wall.bladder.and_then(|b| char::from_digit(b as u32, 10)).unwrap_or('?'),
    }
}
