//! Plant, person, faults and valves through time.

use nalgebra::{Isometry3, Rotation3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};
use stillpoint_mechanics::contact::mobility::head_between_bladders;
use stillpoint_mechanics::plant::equilibrium::EquilibriumError;
use stillpoint_mechanics::plant::{Drive, Plant, State};
use stillpoint_samples::{ContactsElement, DutiesElement, RigMode, RigStateElement};

use super::fault::{Fault, Scheduled};
use super::hardware::{Hardware, Imperfections};
use super::safety::Safety;
use crate::involuntary::Involuntary;

/// Why a rig cannot start.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum StartError {
    /// The air that the rig starts with does not bear the head.
    #[error("the head does not rest on the bladders: {0}")]
    NoRest(#[from] EquilibriumError),
    /// A step that is none.
    #[error("the plant's step is {0} ns; give 1000 to 1000000 ns")]
    Step(u64),
    /// A fault of a part that the rig does not have.
    #[error("fault {index} names {part} {number}, and the rig has {count}, counted from 0")]
    NoSuchPart {
        /// Number of the fault in the list, from 0.
        index: usize,
        /// `valve` or `bladder`.
        part: &'static str,
        /// The part that it names.
        number: usize,
        /// How many there are.
        count: usize,
    },
    /// Too many faults by people are active.
    #[error("{MOST_BROKEN} faults by people are active already: send `mend` first")]
    TooMuchBroken,
}

/// Force below which a bladder counts as low, N.
const LOW: f64 = 1.0;

/// How the head is held between its contacts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mobility {
    /// Of head and bladders by the count of links and joints (3.1).
    pub count: i64,
    pub touching: u32,
    pub sliding: u32,
}

/// Largest number of faults by people at a time.
const MOST_BROKEN: usize = 64;

/// A push at the head: the distance by which it would move the head without other motion while the valves stay shut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Push {
    /// x, y, z, pitch, roll, yaw; m and rad.
    pub offset: [f64; 6],
    /// When, ns after the rig's start.
    pub begin: u64,
    /// End of the simulation, ns.
    pub end: u64,
}

/// What surrounds a plant.
#[derive(Debug, Clone, PartialEq)]
pub struct Surroundings {
    /// What the person does.
    pub involuntary: Involuntary,
    /// Pushes by the hand of another person.
    pub pushes: Vec<Push>,
    pub faults: Vec<Scheduled>,
    /// What valves, rubber and contacts do.
    pub imperfections: Imperfections,
    /// Longest step of the plant, ns.
    pub step: u64,
}

/// A rig through time. Times are ns after its start.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation<const D: usize, const B: usize, const N: usize> {
    plant: Plant<D, B, N>,
    /// Which of x, y, z, pitch, roll, yaw each coordinate is.
    channels: [usize; D],
    surroundings: Surroundings,
    safety: Safety<B>,
    hardware: Hardware<D, B>,
    state: State<D, B>,
    /// Coordinates at the start: poses are told from there.
    start: SVector<f64, D>,
    /// Of the head on its bladders with the valves shut, at the start. It turns involuntary motion into force.
    hold: SMatrix<f64, D, D>,
    /// The opening at which each stuck valve stuck, fault by fault.
    stuck: Vec<Option<f64>>,
    /// How many faults are of the script; those behind them are people's.
    scripted: usize,
    now: u64,
}

impl<const D: usize, const B: usize, const N: usize> Simulation<D, B, N> {
    /// A rig at rest on this much air (kg) in its bladders. `channels` says which of x, y, z, pitch, roll, yaw each
    /// coordinate of the plant is; `guess` is near its rest.
    ///
    /// # Errors
    /// [`StartError`] where the air does not bear the head, or a fault names what is not there.
    pub fn new(
        plant: Plant<D, B, N>,
        channels: [usize; D],
        air: SVector<f64, B>,
        guess: SVector<f64, D>,
        safety: Safety<B>,
        surroundings: Surroundings,
    ) -> Result<Self, StartError> {
        if !(1_000..=1_000_000).contains(&surroundings.step) {
            return Err(StartError::Step(surroundings.step));
        }
        for (index, scheduled) in surroundings.faults.iter().enumerate() {
            Self::check(index, &scheduled.fault)?;
        }
        let start = plant.equilibrium(&air, guess)?;
        let (_, slope) = plant.static_force(&start, &air);
        let state = State::at_rest(start, air);
        Ok(Self {
            channels,
            safety,
            hardware: Hardware::new(surroundings.imperfections, &plant, &channels, &state),
            state,
            start,
            hold: -slope,
            stuck: vec![None; surroundings.faults.len()],
            scripted: surroundings.faults.len(),
            surroundings,
            plant,
            now: 0,
        })
    }

    /// Whether the rig has the part that a fault names.
    fn check(index: usize, fault: &Fault) -> Result<(), StartError> {
        let (part, number, count) = match *fault {
            Fault::StuckValve { valve } => ("valve", valve, 2 * B),
            Fault::Leak { bladder, .. } => ("bladder", bladder, B),
            _ => return Ok(()),
        };
        if number < count { Ok(()) } else { Err(StartError::NoSuchPart { index, part, number, count }) }
    }

    /// Force of the person and of pushes on the head: the force that would move the head by their offsets with shut
    /// valves and a slow motion.
    fn hands(&self) -> SVector<f64, D> {
        let (translation, angles) = self.surroundings.involuntary.offset(self.now as f64 * 1e-9);
        let mut all = [translation.x, translation.y, translation.z, angles.x, angles.y, angles.z];
        for push in self.surroundings.pushes.iter().filter(|p| (p.begin..p.end).contains(&self.now)) {
            for (sum, part) in all.iter_mut().zip(push.offset) {
                *sum += part;
            }
        }
        let offset = SVector::<f64, D>::from_fn(|i, _| all[self.channels[i]]);
        self.hold * offset
    }

    /// What drives the plant at this moment. Valves that stick remember where.
    fn drive(&mut self) -> Drive<D, B> {
        let mut drive = self.plant.idle();
        drive.duty = self.hardware.openings(self.now, self.safety.duty(self.now));
        drive.wall = self.hardware.walls();
        drive.force = self.hands();
        if let Some(friction) = self.hardware.friction() {
            drive.force += friction;
        }
        drive.held = self.hardware.held(&self.plant, &self.state.position);
        let room = self.plant.air.atmosphere;
        if self.safety.mode(self.now) == RigMode::Venting {
            drive.exhaust = room;
        }
        for (scheduled, stuck) in self.surroundings.faults.iter().zip(&mut self.stuck) {
            if !scheduled.acts(self.now) {
                *stuck = None;
                continue;
            }
            match scheduled.fault {
                Fault::StuckValve { valve } => {
                    let opening = &self.state.opening[valve / 2][valve % 2];
                    drive.duty[valve / 2][valve % 2] = *stuck.get_or_insert(*opening);
                }
                Fault::Leak { bladder, diameter } => {
                    let area = 0.25 * core::f64::consts::PI * diameter * diameter;
                    drive.leak[bladder] += self.plant.valves.discharge * area;
                }
                Fault::WeakSupply { left } => drive.supply = room + left * (drive.supply - room),
                Fault::BlindCamera | Fault::SilentCamera | Fault::FrozenCamera | Fault::LostDuties { .. } => {
                }
            }
        }
        drive
    }
}

/// A rig of any number of bladders.
pub trait Rig: Send {
    /// Takes duties that were made at `stamp` and arrive now; all times are ns after the start.
    fn command(&mut self, duties: &DutiesElement, stamp: u64, now: u64);
    /// Goes on to a time, ns after the start.
    fn advance(&mut self, to: u64);
    /// The head's pose when it lay at `rest` at the start.
    fn couch_from_head(&self, rest: &Isometry3<f64>) -> Isometry3<f64>;
    /// Pressures, air, valves and faults.
    fn state(&self) -> RigStateElement;
    /// Forces at the contacts.
    fn contacts(&self) -> ContactsElement;
    /// How the contacts hold the head.
    fn mobility(&self) -> Mobility;
    /// Begins a fault now, for this many ns or until it is removed.
    ///
    /// # Errors
    /// [`StartError`] where the rig does not have the part, or too much is broken.
    fn break_now(&mut self, fault: Fault, lasts: Option<u64>) -> Result<(), StartError>;
    /// Removes the faults of [`break_now`](Self::break_now).
    fn mend(&mut self);
    /// The faults that act, as the bits of [`RigStateElement::faults`].
    fn faults(&self) -> u32;
    /// The part of the duties that arrives, 0 to 1.
    fn arriving(&self) -> f64;
}

impl<const D: usize, const B: usize, const N: usize> Rig for Simulation<D, B, N> {
    fn command(&mut self, duties: &DutiesElement, stamp: u64, now: u64) {
        self.safety.take(duties, stamp, now);
    }

    fn advance(&mut self, to: u64) {
        let whole = to.saturating_sub(self.now);
        let steps = whole.div_ceil(self.surroundings.step);
        let from = self.now;
        for i in 1..=steps {
            let drive = self.drive();
            // Equal steps whose ends are whole ns.
            let next = from + (u128::from(whole) * u128::from(i) / u128::from(steps)) as u64;
            let h = (next - self.now) as f64 * 1e-9;
            let before = self.state;
            self.state = self.plant.advance(&before, &drive, h);
            self.hardware.advance(&self.plant, &before, &self.state, h);
            self.now = next;
        }
    }

    fn couch_from_head(&self, rest: &Isometry3<f64>) -> Isometry3<f64> {
        let mut moved = [0.0; 6];
        for (i, channel) in self.channels.iter().enumerate() {
            moved[*channel] = self.state.position[i] - self.start[i];
        }
        let [x, y, z, pitch, roll, yaw] = moved;
        let turn = match &self.plant.rolling {
            // Of contacts that roll the angles are no small ones: the turn since the start.
            Some(rolling) => {
                let [now, then] = [&self.state.position, &self.start].map(|q| rolling.placed(q).turn);
                UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
                    now * then.transpose(),
                ))
            }
            None => UnitQuaternion::from_euler_angles(pitch, roll, yaw),
        };
        let place = rest.translation.vector + Vector3::new(x, y, z);
        Isometry3::from_parts(Translation3::from(place), turn * rest.rotation)
    }

    fn state(&self) -> RigStateElement {
        let gaps = self.plant.gaps(&self.state.position);
        let mut element = RigStateElement {
            pressure: [0.0; 8],
            air_mass: [0.0; 8],
            gap: [0.0; 8],
            force: [0.0; 8],
            opening: [0.0; 16],
            duties_age: self.safety.age(self.now).map_or(f64::NAN, |ns| ns as f64 * 1e-9),
            refused: self.safety.refused(),
            bladders: B as u32,
            mode: self.safety.mode(self.now) as u32,
            faults: self.faults(),
            unmodelled: 0,
        };
        for (j, pressed) in self.plant.creeping(&self.state, &self.hardware.walls()).iter().enumerate() {
            element.pressure[j] = pressed.pressure;
            element.air_mass[j] = self.state.air[j];
            element.gap[j] = gaps[j];
            element.force[j] = pressed.force();
            element.opening[2 * j..2 * j + 2].copy_from_slice(&self.state.opening[j]);
            element.unmodelled |= u32::from(!pressed.is_modelled(&self.plant.shell)) << j;
        }
        element
    }

    fn contacts(&self) -> ContactsElement {
        let gaps = self.plant.gaps(&self.state.position);
        let mut element = ContactsElement { bladders: B as u32, ..ContactsElement::default() };
        for (j, pressed) in self.plant.creeping(&self.state, &self.hardware.walls()).iter().enumerate() {
            let along = self.hardware.along(j, pressed);
            element.force[j] = pressed.force();
            element.tangential[j] = along.force;
            element.margin[j] = along.margin;
            element.gap[j] = gaps[j];
            element.low |= u32::from(pressed.force() < LOW) << j;
            element.slides |= u32::from(along.slides) << j;
        }
        element
    }

    fn mobility(&self) -> Mobility {
        let pressed = self.plant.creeping(&self.state, &self.hardware.walls());
        let along: [_; B] = core::array::from_fn(|j| self.hardware.along(j, &pressed[j]));
        let count = |requested: fn(&(f64, bool)) -> bool| {
            let contacts = pressed.iter().zip(&along).map(|(pressed, along)| (pressed.force(), along.slides));
            contacts.filter(requested).count() as u32
        };
        Mobility {
            count: head_between_bladders(along.iter().map(|along| along.freedoms)),
            touching: count(|(force, _)| *force > 0.0),
            sliding: count(|(force, slides)| *force > 0.0 && *slides),
        }
    }

    fn break_now(&mut self, fault: Fault, lasts: Option<u64>) -> Result<(), StartError> {
        let faults = &mut self.surroundings.faults;
        Self::check(faults.len(), &fault)?;
        // What is over makes room.
        for index in (self.scripted..faults.len()).rev() {
            if faults[index].end <= self.now {
                faults.remove(index);
                self.stuck.remove(index);
            }
        }
        if faults.len() >= self.scripted + MOST_BROKEN {
            return Err(StartError::TooMuchBroken);
        }
        let end = lasts.map_or(u64::MAX, |lasts| self.now.saturating_add(lasts));
        faults.push(Scheduled { fault, begin: self.now, end });
        self.stuck.push(None);
        Ok(())
    }

    fn mend(&mut self) {
        self.surroundings.faults.truncate(self.scripted);
        self.stuck.truncate(self.scripted);
    }

    fn faults(&self) -> u32 {
        let acting = self.surroundings.faults.iter().filter(|s| s.acts(self.now));
        acting.fold(0, |bits, s| bits | s.fault.bit())
    }

    fn arriving(&self) -> f64 {
        let acting = self.surroundings.faults.iter().filter(|s| s.acts(self.now));
        acting.fold(1.0, |part, s| if let Fault::LostDuties { left } = s.fault { part * left } else { part })
    }
}
