//! `stillpoint-bridge listen`: when messages arrive on topics of ROS 2. `stillpoint doctor` starts it.

use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::{Value, json};
use stillpoint_cdr::schema;
use stillpoint_remote::{Ros2, Ros2Message, Ros2Settings};

use super::exchange::{Ending, ended};
use crate::error::BridgeError;

/// How long the router is waited for.
const PATIENCE: Duration = Duration::from_secs(3);
/// Between two looks at the clock and at signals.
const LOOK: Duration = Duration::from_millis(20);
/// Messages of a topic whose times are retained.
const MOST: usize = 100_000;

/// Listen to topics of ROS 2, and print as JSON when their messages arrived.
#[derive(Args)]
pub struct Listen {
    /// Endpoint of the router of ROS 2, `tcp/ADDRESS:PORT`.
    #[arg(long, value_name = "ENDPOINT")]
    connect: String,
    /// The domain.
    #[arg(long, default_value_t = 0)]
    domain: u32,
    /// Seconds from the time at which the router is there.
    #[arg(long)]
    seconds: f64,
    /// The topics with their types, as `/camera/depth/image_raw=sensor_msgs/msg/Image`.
    #[arg(required = true, value_name = "TOPIC=TYPE")]
    topics: Vec<String>,
}

/// What arrived on a topic.
#[derive(Default)]
struct Arrived {
    /// Times of messages of the type, ns since the start.
    at_ns: Vec<u64>,
    /// Messages of another type.
    other_type: u64,
}

impl Listen {
    /// Executes the subcommand.
    pub fn execute(&self) -> ExitCode {
        ended(self.listen().map(|found| println!("{found}")))
    }

    fn listen(&self) -> Result<Value, BridgeError> {
        let ending = Ending::watch()?;
        let node = Ros2::open(Ros2Settings {
            connect: self.connect.clone(),
            domain: self.domain,
            node: "stillpoint_doctor".to_owned(),
            longest: 0,
        })?;
        let begun = Instant::now();
        let mut topics = Vec::new();
        for text in &self.topics {
            let named = text.split_once('=').and_then(|(topic, type_name)| {
                Some((topic, schema::ALL.into_iter().find(|(name, _)| *name == type_name)?))
            });
            let (topic, of_type) = named.ok_or_else(|| BridgeError::Topic(text.clone()))?;
            let arrived = Arc::new(Mutex::new(Arrived::default()));
            topics.push((topic, arrived.clone()));
            let take = move |message: &Ros2Message<'_>| {
                let mut arrived = arrived.lock().unwrap_or_else(PoisonError::into_inner);
                if !message.is_of_type {
                    arrived.other_type += 1;
                } else if arrived.at_ns.len() < MOST {
                    arrived.at_ns.push(u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX));
                }
            };
            node.take(topic, of_type, Arc::new(take))?;
        }
        let wait = |time: Duration, is_over: &dyn Fn() -> bool| {
            let begun = Instant::now();
            while begun.elapsed() < time && !is_over() && !ending.is_time() {
                std::thread::sleep(LOOK);
            }
        };
        wait(PATIENCE, &|| node.is_connected());
        let is_connected = node.is_connected();
        if is_connected {
            let time = Duration::try_from_secs_f64(self.seconds).unwrap_or(PATIENCE);
            wait(time, &|| false);
        }
        let remarks: Vec<String> =
            node.events().into_iter().filter(|event| event.is_fault).map(|event| event.text).collect();
        // From here on nothing arrives.
        drop(node);
        let found = topics.iter().map(|(topic, arrived)| {
            let arrived = arrived.lock().unwrap_or_else(PoisonError::into_inner);
            json!({ "topic": topic, "at_ns": arrived.at_ns, "other_type": arrived.other_type })
        });
        Ok(json!({ "connected": is_connected, "topics": found.collect::<Vec<_>>(), "remarks": remarks }))
    }
}
