//! What a live run exchanges with ROS 2: the bridge carries it, as it carries what goes from one host to another.

use crate::graph::{Graph, Publication, Wire};

impl Graph {
    /// What the operators of this graph publish: operator, output, and what is published of it.
    pub fn publishes(&self) -> impl Iterator<Item = (usize, usize, &Publication)> {
        let publications = self.ros2.iter().flat_map(|ros2| &ros2.publications);
        publications.filter_map(|p| self.topic(&p.of).map(|(operator, port)| (operator, port, p)))
    }

    /// The operators that take topics of ROS 2.
    pub fn subscribes(&self) -> impl Iterator<Item = usize> {
        (0..self.operators.len()).filter(|o| !self.operators[*o].subscriptions.is_empty())
    }

    /// Lets samples leave for ROS 2 and messages arrive from there.
    pub(crate) fn open_to_ros2(&mut self) {
        let leave: Vec<(usize, usize)> =
            self.publishes().map(|(operator, port, _)| (operator, port)).collect();
        for (operator, port) in leave {
            let links = &mut self.operators[operator].outputs[port].links;
            if !links.contains(&Wire::Ros2) {
                links.push(Wire::Ros2);
            }
        }
        let arrive: Vec<usize> = self.subscribes().collect();
        for operator in arrive {
            self.operators[operator].far_end = Some(Wire::Ros2);
        }
    }
}
