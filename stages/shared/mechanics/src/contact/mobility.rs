//! How many coordinates a mechanism has by the count of its links and joints (3.1)-(3.2), SCIENCE B1.
//!
//! The count takes the joints for independent of each other. Where loops close on each other it says less than the
//! rank of the grasp map does: a negative count tells how many internal forces no motion of the links relieves.

/// What two soft fingers that stick to each other leave free: rolling in two directions.
pub const STICKING: u32 = 2;
/// What a contact that slides leaves free: rolling in two directions, sliding in two, and spinning.
pub const SLIDING: u32 = 5;
/// A contact that is open leaves everything free.
pub const OPEN: u32 = 6;
/// What the wall of a bladder leaves free between its couch and its contact: its height, its shear in two directions,
/// and its twist.
pub const BLADDER: u32 = 4;

/// Mobility of `links` moving links in space with these joints, each by the freedoms that it leaves:
/// `F = 6 (N - g) + sum f_i` (3.1).
pub fn spatial(links: u32, joints: impl IntoIterator<Item = u32>) -> i64 {
    count(6, links, joints)
}

/// The same in the plane: `F = 3 (N - g) + sum f_i` (3.2).
pub fn planar(links: u32, joints: impl IntoIterator<Item = u32>) -> i64 {
    count(3, links, joints)
}

/// Mobility of a head whose contacts leave `freedoms` each, between bladders that yield: a link and two joints for each.
pub fn head_between_bladders(freedoms: impl ExactSizeIterator<Item = u32>) -> i64 {
    let bladders = freedoms.len() as u32;
    spatial(1 + bladders, freedoms.flat_map(|freedom| [BLADDER, freedom]))
}

fn count(whole: i64, links: u32, joints: impl IntoIterator<Item = u32>) -> i64 {
    joints.into_iter().fold(whole * i64::from(links), |sum, freedom| sum - whole + i64::from(freedom))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::grasp::{Touch, null_space, soft_fingers};
    use crate::plant::layouts::touching;
    use proptest::prelude::*;

    #[test]
    fn a_hinge_a_linkage_and_the_count_of_the_source() {
        assert_eq!((planar(1, [1]), planar(3, [1; 4]), spatial(1, [0])), (1, 1, 0));
        // Eight links with as many joints of two freedoms each, in the plane and in space.
        assert_eq!((planar(8, [2; 8]), spatial(8, [2; 8])), (16, 16));
    }

    #[test]
    fn a_head_that_sticks_to_rigid_bladders_is_locked_by_as_many_forces_as_the_grasp_map_has_null_vectors() {
        let touches: Vec<Touch> =
            touching::<8>().map(|places| places.map(|(arm, normal)| Touch { arm, normal })).unwrap().to_vec();
        let internal = null_space(&soft_fingers(&touches)).ncols() as i64;
        assert_eq!((spatial(1, [STICKING; 8]), internal), (-26, 26));
    }

    proptest! {
        #[test]
        fn a_head_that_sticks_to_bladders_that_yield_keeps_its_six_coordinates_and_sliding_adds_three(
            slides in prop::collection::vec(any::<bool>(), 1..9),
        ) {
            let freedoms = slides.iter().map(|slides| if *slides { SLIDING } else { STICKING });
            let sliding = slides.iter().filter(|slides| **slides).count() as i64;
            prop_assert_eq!(head_between_bladders(freedoms), 6 + 3 * sliding);
        }
    }
}
