//! From the net duty of each bladder to its two valves (4.41 with paired valves, SCIENCE E6).

/// Splits net duties over inlets and outlets: `u_in = clip(v, 0, 1)`, `u_out = clip(-v, 0, 1)`. Bit i of what is returned
/// is set where valve i is to be wide open, or more. `duty` has two numbers for each of `net`.
pub fn split(net: &[f64], duty: &mut [f64]) -> u32 {
    let mut saturated = 0;
    for (i, (v, pair)) in net.iter().zip(duty.chunks_exact_mut(2)).enumerate() {
        pair[0] = v.clamp(0.0, 1.0);
        pair[1] = (-v).clamp(0.0, 1.0);
        if *v >= 1.0 {
            saturated |= 1 << (2 * i);
        }
        if *v <= -1.0 {
            saturated |= 2 << (2 * i);
        }
    }
    saturated
}

/// Brings net duties into -1 to 1, and says by how much they were beyond, all squares summed.
pub fn clip(net: &mut [f64]) -> f64 {
    let mut beyond = 0.0;
    for v in net {
        let within = v.clamp(-1.0, 1.0);
        beyond += (*v - within) * (*v - within);
        *v = within;
    }
    beyond
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_valve_that_cannot_open_far_enough_is_named() {
        let mut duty = [9.0; 6];
        assert_eq!(split(&[1.5, -0.2, -3.0], &mut duty), 0b10_0001);
        assert_eq!(duty, [1.0, 0.0, 0.0, 0.2, 0.0, 1.0]);
    }

    #[test]
    fn clipping_says_how_much_was_too_much() {
        let mut net = [1.5, -0.5, -3.0];
        assert_eq!(clip(&mut net), 4.25);
        assert_eq!(net, [1.0, -0.5, -1.0]);
    }
}
