//! A rigid head on bladders with valves: the equations of motion (SCIENCE C5, C6).
//!
//! `M q'' = J^T F - w - K q - D q'`, `gap = d0 + J q`; each bladder's air comes through its inlet from the supply and
//! leaves through its outlet to the exhaust; each opening follows its duty with a lag.
//!
//! With contacts that roll ([`Rolling`]) the gaps and their slopes follow from the present contacts, and the equations are
//! those of (3.62): head and walls together, `(M_h + H^T M_b H) q'' + (C_h + H^T M_b H') q' + N = H^T tau`.

use nalgebra::{SMatrix, SVector};

use super::grip::Held;
use super::plate::Pressed;
use super::rolling::{Met, Rolling};
use super::valve::{Orifice, Valves};
use crate::dormand_prince;
use crate::dynamics::reduced::{acceleration, together};
use crate::shell::Shell;
use crate::shell::air::Air;
use crate::shell::rubber::Wall;

/// A valve that is less open than this counts as shut. Otherwise an opening that follows a duty of zero would decay
/// forever, to denormal numbers.
const SHUT: f64 = 1e-12;

/// What a bladder lies on when it is flat: a pad that pushes back where its gap is below `gap`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop {
    /// Where it begins, m.
    pub gap: f64,
    /// N/m.
    pub stiffness: f64,
    /// N s/m.
    pub damping: f64,
}

/// A head with `D` degrees of freedom on `B` bladders. `N` is the length of its packed state, `2 D + 3 B`.
#[derive(Debug, Clone, PartialEq)]
pub struct Plant<const D: usize, const B: usize, const N: usize> {
    /// The material of each bladder.
    pub shell: Shell,
    /// The air in the bladders.
    pub air: Air,
    /// How air gets in and out.
    pub valves: Valves,
    /// Masses and moments of inertia, kg and kg m^2.
    pub inertia: SVector<f64, D>,
    /// What pulls against the bladders at all times: weight, N and N m.
    pub weight: SVector<f64, D>,
    pub stiffness: SMatrix<f64, D, D>,
    pub damping: SMatrix<f64, D, D>,
    /// Gaps at `q = 0`, m.
    pub gap_at_zero: SVector<f64, B>,
    /// How gaps change with `q`; its transpose turns the bladders' forces into generalised ones.
    pub jacobian: SMatrix<f64, B, D>,
    /// What the bladders lie on.
    pub stop: Option<Stop>,
    /// Contacts that move over head and bladders. Without them the contacts stay where the Jacobian has them.
    pub rolling: Option<Rolling<D, B>>,
    orifice: Orifice,
}

/// Where a plant is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State<const D: usize, const B: usize> {
    /// Coordinates, m and rad.
    pub position: SVector<f64, D>,
    pub rate: SVector<f64, D>,
    /// Air in each bladder, kg.
    pub air: SVector<f64, B>,
    /// Opening of each bladder's inlet and outlet, 0 to 1.
    pub opening: [[f64; 2]; B],
}

/// What drives a plant, constant over a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive<const D: usize, const B: usize> {
    /// Duty of each bladder's inlet and outlet, 0 to 1.
    pub duty: [[f64; 2]; B],
    /// What else acts on the head, N and N m: breath, muscles, a hand.
    pub force: SVector<f64, D>,
    /// Effective area of a hole in each bladder, m^2.
    pub leak: [f64; B],
    /// Absolute pressure before the inlets, Pa.
    pub supply: f64,
    /// Absolute pressure behind the outlets, Pa.
    pub exhaust: f64,
    /// The rubber of each bladder.
    pub wall: [Wall; B],
    /// Tangential forces of contacts that roll.
    pub held: Option<Held<D>>,
}

/// What a plant is built of, besides bladders, air and valves: see the fields of [`Plant`].
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)]
pub struct BodyFrame<const D: usize, const B: usize> {
    pub inertia: SVector<f64, D>,
    pub weight: SVector<f64, D>,
    pub stiffness: SMatrix<f64, D, D>,
    pub damping: SMatrix<f64, D, D>,
    pub gap_at_zero: SVector<f64, B>,
    pub jacobian: SMatrix<f64, B, D>,
}

impl<const D: usize, const B: usize, const N: usize> Plant<D, B, N> {
    const PACKED: () = assert!(N == 2 * D + 3 * B, "a plant's state has 2 D + 3 B numbers");

    /// A head of this frame on bladders of `shell`.
    pub fn new(shell: Shell, air: Air, valves: Valves, frame: BodyFrame<D, B>) -> Self {
        let () = Self::PACKED;
        let BodyFrame { inertia, weight, stiffness, damping, gap_at_zero, jacobian } = frame;
        let orifice = Orifice::new(&air);
        Self {
            shell,
            air,
            valves,
            inertia,
            weight,
            stiffness,
            damping,
            gap_at_zero,
            jacobian,
            stop: None,
            rolling: None,
            orifice,
        }
    }

    /// The same, with foam under the bladders.
    pub fn with_stop(self, stop: Stop) -> Self {
        Self { stop: Some(stop), ..self }
    }

    /// The same, with contacts that move over head and bladders.
    pub fn with_rolling(self, rolling: Rolling<D, B>) -> Self {
        Self { rolling: Some(rolling), ..self }
    }

    /// Shut valves, and supply and exhaust as the rig has them.
    pub fn idle(&self) -> Drive<D, B> {
        Drive {
            duty: [[0.0; 2]; B],
            force: SVector::zeros(),
            leak: [0.0; B],
            supply: self.valves.supply,
            exhaust: self.valves.exhaust,
            wall: [Wall::ELASTIC; B],
            held: None,
        }
    }

    /// The gap of each bladder, m.
    pub fn gaps(&self, position: &SVector<f64, D>) -> SVector<f64, B> {
        match &self.rolling {
            Some(rolling) => rolling.met(position).gaps,
            None => self.gap_at_zero + self.jacobian * position,
        }
    }

    /// How the gaps change with the position. The transpose turns the bladders' forces into generalised ones.
    pub fn gap_slopes(&self, position: &SVector<f64, D>) -> SMatrix<f64, B, D> {
        self.rolling.as_ref().map_or(self.jacobian, |rolling| rolling.met(position).slopes)
    }

    /// Each bladder with this much air (kg) at a position of the head.
    pub fn bladders(&self, position: &SVector<f64, D>, air: &SVector<f64, B>) -> [Pressed; B] {
        let gaps = self.gaps(position);
        core::array::from_fn(|j| self.shell.pressed_with(air[j], &self.air, gaps[j]))
    }

    /// Each bladder of a state with walls that creep.
    pub fn creeping(&self, state: &State<D, B>, wall: &[Wall; B]) -> [Pressed; B] {
        let gaps = self.gaps(&state.position);
        core::array::from_fn(|j| self.shell.creeping_with(state.air[j], &self.air, gaps[j], &wall[j]))
    }

    /// Air that flows into a bladder through its inlet at full opening, at a gauge pressure (Pa) inside, kg/s.
    pub fn inlet_flow(&self, gauge: f64) -> f64 {
        let inside = self.air.atmosphere + gauge;
        self.orifice.flow(self.valves.effective_area(1.0), self.valves.supply, inside)
    }

    /// Rate of each component of the packed state.
    pub fn slope(&self, packed: &SVector<f64, N>, drive: &Drive<D, B>) -> SVector<f64, N> {
        let state = State::<D, B>::unpack(packed);
        let met = self.rolling.as_ref().map(|rolling| rolling.met(&state.position));
        let slopes = met.as_ref().map_or(self.jacobian, |met| met.slopes);
        let gaps = met.as_ref().map_or_else(|| self.gaps(&state.position), |met| met.gaps);
        let gap_rates = slopes * state.rate;
        let mut push = SVector::<f64, B>::zeros();
        let mut air_rate = SVector::<f64, B>::zeros();
        for j in 0..B {
            let pressed = self.shell.creeping_with(state.air[j], &self.air, gaps[j], &drive.wall[j]);
            push[j] = pressed.force() + self.stop.map_or(0.0, |stop| stop.force(gaps[j], gap_rates[j]));
            let inside = self.air.atmosphere + pressed.pressure;
            let [inlet, outlet] = state.opening[j].map(|opening| self.valves.effective_area(opening));
            air_rate[j] = self.orifice.flow(inlet, drive.supply, inside)
                - self.orifice.flow(outlet, inside, drive.exhaust)
                - self.orifice.flow(drive.leak[j], inside, self.air.atmosphere);
        }
        let opening = core::array::from_fn(|j| {
            core::array::from_fn(|v| (drive.duty[j][v] - state.opening[j][v]) / self.valves.lag)
        });
        let rate = match (&self.rolling, &met) {
            (Some(rolling), Some(met)) => self.carrying(rolling, met, &state, drive, &push),
            _ => {
                let force = slopes.transpose() * push + drive.force
                    - self.weight
                    - self.stiffness * state.position
                    - self.damping * state.rate;
                force.component_div(&self.inertia)
            }
        };
        State { position: state.rate, rate, air: air_rate, opening }.pack()
    }

    /// Accelerations of a head that carries the walls of its bladders along (3.62).
    fn carrying(
        &self,
        rolling: &Rolling<D, B>,
        met: &Met<D, B>,
        state: &State<D, B>,
        drive: &Drive<D, B>,
        push: &SVector<f64, B>,
    ) -> SVector<f64, D> {
        let mut head = rolling.head_terms(&self.inertia, &state.position, &state.rate);
        head.velocity += self.damping;
        head.load += self.weight + self.stiffness * state.position - drive.force;
        if let Some(held) = &drive.held {
            head.load -= held.force(&state.position);
        }
        let carried = rolling.carried(met, &state.rate);
        let all = together(&head, &rolling.walls(), &carried);
        // Only at a roll of 90 degrees are the angles no coordinates.
        acceleration(&all, &carried, &state.rate, push).unwrap_or_else(|| SVector::repeat(f64::NAN))
    }

    /// The state `h` seconds later, by one step of Dormand and Prince's method. A step of 1 ms is exact to well below
    /// what a camera sees.
    pub fn advance(&self, state: &State<D, B>, drive: &Drive<D, B>, h: f64) -> State<D, B> {
        let step = dormand_prince::step(|_, y| self.slope(y, drive), 0.0, &state.pack(), h);
        let mut later = State::unpack(&step.state);
        for opening in later.opening.iter_mut().flatten().filter(|opening| opening.abs() < SHUT) {
            *opening = 0.0;
        }
        later
    }
}

impl Stop {
    fn force(&self, gap: f64, rate: f64) -> f64 {
        if gap < self.gap { (self.stiffness * (self.gap - gap) - self.damping * rate).max(0.0) } else { 0.0 }
    }
}

impl<const D: usize, const B: usize> State<D, B> {
    /// At rest at a position with this much air (kg) in the bladders, all valves shut.
    pub fn at_rest(position: SVector<f64, D>, air: SVector<f64, B>) -> Self {
        Self { position, rate: SVector::zeros(), air, opening: [[0.0; 2]; B] }
    }

    /// Position, rates, air, and the openings of inlet and outlet bladder by bladder. `N` is `2 D + 3 B`.
    pub fn pack<const N: usize>(&self) -> SVector<f64, N> {
        let mut packed = SVector::<f64, N>::zeros();
        packed.rows_mut(0, D).copy_from(&self.position);
        packed.rows_mut(D, D).copy_from(&self.rate);
        packed.rows_mut(2 * D, B).copy_from(&self.air);
        for (i, opening) in self.opening.iter().flatten().enumerate() {
            packed[2 * D + B + i] = *opening;
        }
        packed
    }

    /// The inverse of [`pack`](Self::pack).
    pub fn unpack<const N: usize>(packed: &SVector<f64, N>) -> Self {
        Self {
            position: packed.fixed_rows::<D>(0).into_owned(),
            rate: packed.fixed_rows::<D>(D).into_owned(),
            air: packed.fixed_rows::<B>(2 * D).into_owned(),
            opening: core::array::from_fn(|j| core::array::from_fn(|v| packed[2 * D + B + 2 * j + v])),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::OneDof;

    #[test]
    fn a_valve_that_was_shut_is_shut_after_a_while() {
        let plant = OneDof::rig(5.0);
        let mut state = State::at_rest(SVector::zeros(), plant.start_air());
        state.opening[0] = [1.0, 0.5];
        let mut openings = Vec::new();
        for _ in 0..1000 {
            state = plant.advance(&state, &plant.idle(), 1e-3);
            openings.push(state.opening[0]);
        }
        // With a lag of 20 ms: 1e-12 after 0.55 s.
        assert!(openings[500][0] > 1e-12 && openings[500][0] < 1e-10, "{:?}", openings[500]);
        assert_eq!(openings[999], [0.0; 2]);
    }

    #[test]
    fn a_leak_takes_air_out_of_a_bladder_as_its_hole_passes_it() {
        let plant = OneDof::rig(5.0);
        let state = State::at_rest(SVector::from([0.085]), plant.start_air());
        let mut drive = plant.idle();
        let flow = |drive: &Drive<1, 1>| plant.slope(&state.pack::<5>(), drive)[2];
        assert_eq!(flow(&drive), 0.0);
        drive.leak = [1e-7];
        let pressed = plant.bladders(&state.position, &state.air)[0];
        let inside = plant.air.atmosphere + pressed.pressure;
        let out = Orifice::new(&plant.air).flow(1e-7, inside, plant.air.atmosphere);
        assert!(out > 0.0 && flow(&drive) == -out, "{} {out}", flow(&drive));
    }

    #[test]
    fn foam_pushes_by_its_depth_and_against_motion_but_never_pulls() {
        let foam = Stop { gap: 0.06, stiffness: 2e4, damping: 300.0 };
        let near = |found: f64, due: f64| assert!((found - due).abs() < 1e-9, "{found} {due}");
        near(foam.force(0.059, 0.0), 20.0);
        // The head sinks at 0.05 m/s: the foam pushes more; it rises: less, and no further than to nothing.
        near(foam.force(0.059, -0.05), 35.0);
        near(foam.force(0.059, 0.05), 5.0);
        near(foam.force(0.059, 0.5), 0.0);
        near(foam.force(0.061, -1.0), 0.0);
    }
}
