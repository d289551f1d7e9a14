//! - `vectors`: vector files
//! - `comparison`: the controllers side by side
//! - `gains`: Riccati and Lyapunov equations, linear-quadratic control
//! - `printed_gains`: the gains that the dissertation prints do nothing
//! - `adaptive`: adaptive laws along the reference trajectories
//! - `rates`: the adaptive law in rates, and its error bound
//! - `rig_loop`: the adaptive loop on the rig of three bladders
//! - `allocation`: steps that take nothing from the heap
//! - `learned`: controllers with an identified plant or a trained network
//! - `network`: the recurrent network, its file and its features
//! - `plants`: heads on bladders that answer to duties
//! - `goals`: `control.target` on a bench
//! - `squeeze`: bladders that are more than the channels they hold
//! - `loops`: target, controller and head in a loop

mod adaptive;
mod allocation;
mod comparison;
mod gains;
mod goals;
mod learned;
mod loops;
mod network;
mod plants;
mod printed_gains;
mod rates;
mod rig_loop;
mod squeeze;
mod vectors;
