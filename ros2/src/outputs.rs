//! The topics that the node publishes.

use crate::bus::{Bus, BusError, Quality, Writer};
use crate::names::{NodeName, Remap, resolve};
use std::collections::BTreeMap;
use stillpoint::ros_events::{Outgoing, Topic};

/// Maximum number of messages queued for a reliable subscriber.
const DEPTH: u16 = 30;

/// A writer for each topic.
pub struct Outputs(BTreeMap<Topic, Writer>);

/// The name of a topic, before remapping: those of the node itself are in its own namespace.
#[must_use]
pub fn name_of(topic: Topic) -> String {
    match topic.name().strip_prefix("/stillpoint/") {
        Some(own) => format!("~/{own}"),
        None => topic.name().to_owned(),
    }
}

fn quality(topic: Topic) -> Quality {
    if topic == Topic::TfStatic {
        // Late subscribers should receive all of several constant transforms.
        return Quality {
            depth: 10,
            ..Quality::LATCHED
        };
    }
    if topic.is_latched() {
        return Quality::LATCHED;
    }
    Quality {
        depth: DEPTH,
        ..Quality::DEFAULT
    }
}

impl Outputs {
    /// Creates all writers.
    ///
    /// # Errors
    /// Failures of the middleware.
    pub fn offer(bus: &mut Bus, node: &NodeName, remaps: &[Remap]) -> Result<Self, BusError> {
        let mut writers = BTreeMap::new();
        for topic in Topic::ALL {
            let name = resolve(&name_of(topic), node, remaps);
            let writer = bus.publish(&name, topic.type_name(), quality(topic))?;
            writers.insert(topic, writer);
        }
        Ok(Self(writers))
    }

    /// Sends a message; without subscribers, only if it is latched.
    pub fn send(&self, message: &Outgoing) {
        if let Some(writer) = self.0.get(&message.topic)
            && (message.topic.is_latched() || writer.subscribers() > 0)
        {
            writer.send(&message.bytes);
        }
    }

    /// Whether a topic has subscribers.
    #[must_use]
    pub fn has_subscribers(&self, topic: Topic) -> bool {
        self.0.get(&topic).is_some_and(|w| w.subscribers() > 0)
    }
}
